//! `/api/v1/operations`: the operations of the registry. Each has its own path, whose body is described by the
//! operation's schema.

use super::keys::Keyed;
use super::problem::{Answer, Problem};
use super::reconstructions::{Reconstruction, submit};
use super::{App, At};
use axum::Json;
use axum::extract::State;
use axum::response::Response;
use nacre_base::operation::Registered;
use nacre_capture::plan::{Method, names};
use nacre_processing::operations::OPERATIONS;
use nacre_store::jobs::{LightUpload, Spec};
use schemars::generate::SchemaSettings;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use std::sync::Arc;
use utoipa::ToSchema;

/// Path of an operation.
const PATH: &str = "/api/v1/operations/{name}";

/// Input and options of an operation.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Order {
    /// Name of the result, at most 200 characters. Default: derived from the operation and the name of its input.
    #[schema(max_length = 200)]
    name: Option<String>,
    /// Id of a session.
    session: Option<String>,
    /// Or the id of an upload.
    upload: Option<String>,
    /// Or, for operations on maps, ids of reconstructions or of sessions with results; an upload then holds files that
    /// options name.
    #[serde(default)]
    #[schema(max_items = 1000)]
    results: Vec<String>,
    /// For `lut`: an upload with photographs of the mirror image of an extended light.
    light: Option<LightUpload>,
    /// Options by key; keys left out have their defaults. Options that name files take names of files in the upload,
    /// `result:ID` for a result, `result:ID/FILE` for a file of a result, or `session:ID` for the photographs of a
    /// session.
    #[schema(value_type = Object)]
    #[serde(default)]
    options: Map<String, Value>,
}

/// An operation of the registry.
#[derive(Debug, Serialize, ToSchema)]
pub struct Offered {
    /// Name in paths, plans and jobs.
    name: &'static str,
    /// Its result, in one line.
    title: &'static str,
    /// JSON Schema of its options.
    #[schema(value_type = Object)]
    options: Value,
    /// JSON Schema of the report of its results.
    #[schema(value_type = Object)]
    report: Value,
}

/// Lists all operations, with the JSON Schemas of their options and reports.
#[utoipa::path(get, path = "/api/v1/operations", tag = "operations", operation_id = "operations",
    responses((status = 200, body = Vec<Offered>)))]
pub async fn list() -> Json<Vec<Offered>> {
    let offered = |o: &&dyn Registered| Offered {
        name: o.name(),
        title: o.title(),
        options: o.fields().schema().clone(),
        report: report_of(*o),
    };
    Json(OPERATIONS.iter().map(offered).collect())
}

/// Runs an operation. The answer names a reconstruction, from which state and results are read.
#[utoipa::path(post, path = "/api/v1/operations/{name}", tag = "operations", operation_id = "run",
    request_body = Order, params(("name" = String, Path),
        ("Idempotency-Key" = Option<String>, Header, description = "Ask once only", min_length = 1, max_length = 200)),
    responses((status = 202, body = Reconstruction, headers(("Location" = String, description = "The reconstruction"))),
        (status = 400, body = Problem), (status = 404, body = Problem), (status = 422, body = Problem)))]
pub async fn run(
    State(app): State<Arc<App>>,
    At(name): At<String>,
    Keyed { body, key }: Keyed<Order>,
) -> Answer<Response> {
    let unknown = || Problem::not_found(format!("operation {name}")).remedy(format!("choose one of {}", names()));
    let method = Method::of(&name).ok_or_else(unknown)?;
    let Order { name, session, upload, results, light, options } = body;
    let name = super::naming::asked(name)?;
    if results.is_empty() {
        super::reconstruction_request::check_input(method, [session.as_ref(), upload.as_ref()], light.as_ref())?;
    } else {
        super::used_results::check(method, &results, [session.as_ref(), upload.as_ref()])?;
    }
    let mut spec = Spec { name, operation: method, options, session, upload, light, ..Spec::default() };
    app.look_up_results(&mut spec, &results).await?;
    submit(&app, spec, key).await
}

/// JSON Schema of an operation's report, with its definitions.
fn report_of(operation: &dyn Registered) -> Value {
    let mut generator = SchemaSettings::draft2020_12().for_serialize().into_generator();
    let mut schema = operation.report_schema(&mut generator).to_value();
    schema["$defs"] = generator.take_definitions(true).into();
    schema
}

/// Replaces the common path of all operations in an OpenAPI document by one path each, and adds the schemas of their
/// options.
pub fn describe(document: &mut Value) {
    let settings = SchemaSettings::draft2020_12().with(|s| s.definitions_path = "/components/schemas".into());
    let mut reports = settings.clone().for_serialize().into_generator();
    let mut generator = settings.into_generator();
    let general = document["paths"].as_object_mut().and_then(|paths| paths.shift_remove(PATH)).unwrap_or_default();
    for operation in OPERATIONS {
        let options = operation.schema(&mut generator);
        let mut own = general.clone();
        let post = &mut own["post"];
        post["operationId"] = json!(format!("run_{}", operation.name()));
        post["summary"] = json!(operation.title());
        if let Some(parameters) = post["parameters"].as_array_mut() {
            parameters.retain(|parameter| parameter["in"] != "path");
        }
        let report = operation.report_schema(&mut reports);
        let report =
            report.get("$ref").and_then(Value::as_str).and_then(|name| name.rsplit('/').next()).unwrap_or_default();
        post["responses"]["202"]["description"] = json!(format!("Its report will be a `{report}`"));
        // Schemas are named, since client generators ignore properties beside a reference.
        let named = options.get("$ref").and_then(Value::as_str).unwrap_or_default().replace("Options", "Order");
        let mut order = document["components"]["schemas"]["Order"].clone();
        order["properties"]["options"] = options.to_value();
        if !operation.fields().list.iter().any(|field| field.path == ["light", "path"])
            && let Some(properties) = order["properties"].as_object_mut()
        {
            properties.shift_remove("light");
        }
        post["requestBody"]["content"]["application/json"]["schema"] = json!({ "$ref": named });
        document["components"]["schemas"][named.trim_start_matches("#/components/schemas/")] = order;
        document["paths"][PATH.replace("{name}", operation.name())] = own;
    }
    let Some(schemas) = document["components"]["schemas"].as_object_mut() else { return };
    for (name, schema) in generator.take_definitions(true) {
        debug_assert!(!schemas.contains_key(&name), "two schemas are called {name}");
        schemas.insert(name, schema);
    }
    schemas.extend(told_apart(reports.take_definitions(true), schemas));
    super::clients::simplify(schemas);
}

/// Definitions of reports. A definition that differs from a known schema of the same name is renamed: options in a
/// report have all their keys.
fn told_apart(reports: Map<String, Value>, known: &Map<String, Value>) -> Map<String, Value> {
    let differ = |name: &&String| known.get(*name).is_some_and(|schema| *schema != reports[*name]);
    let names: Vec<&String> = reports.keys().filter(differ).collect();
    let mut text = Value::Object(reports.clone()).to_string();
    for name in names {
        for [before, after] in [["/", "\""], ["\"", "\":{"]] {
            text = text.replace(&format!("{before}{name}{after}"), &format!("{before}{name}InReport{after}"));
        }
    }
    serde_json::from_str(&text).unwrap_or(reports)
}

#[cfg(test)]
mod tests {
    use crate::router::openapi;
    use serde_json::Value;

    #[test]
    fn every_operation_has_its_path_and_its_schema() {
        let document = openapi();
        for operation in super::OPERATIONS {
            let post = &document["paths"][format!("/api/v1/operations/{}", operation.name())]["post"];
            let referred = |to: &Value| {
                let reference = to["$ref"].as_str().unwrap();
                document.pointer(reference.trim_start_matches('#')).unwrap_or_else(|| panic!("no {reference}")).clone()
            };
            let order = referred(&post["requestBody"]["content"]["application/json"]["schema"]);
            let schema = referred(&order["properties"]["options"]);
            for field in &operation.fields().list {
                assert!(
                    schema["properties"].get(&field.path[0]).is_some(),
                    "{} lacks {:?}",
                    operation.name(),
                    field.path
                );
            }
        }
    }
}
