//! All paths of the service.

use super::connections::Activity;
use super::problem::{Answer, Kind, Problem};
use super::{
    App, access, calibrations, charts, connections, deletion, devices, display, map_list, map_regions, measure, naming,
    operations, plans, preview, queue, reconstructions, renders, results, samples, scene_editing, session_data,
    sessions, settings, stored_uploads, tiles, trash, uploads, view,
};
use axum::body::Bytes;
use axum::extract::{DefaultBodyLimit, FromRequest, Path, Request, State};
use axum::http::{Extensions, HeaderMap, StatusCode, Version, header};
use axum::middleware::{self, Next};
use axum::response::{Html, IntoResponse, Response};
use axum::routing::get;
use axum::{Extension, Json, Router};
use serde::Serialize;
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Duration;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::{Predicate, SizeAbove};
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityScheme};
use utoipa::{Modify, OpenApi, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

#[derive(OpenApi)]
#[openapi(
    info(title = "Nacre", description = "Measures how surfaces diffract light.", license(name = "MIT OR Apache-2.0")),
    modifiers(&Token)
)]
struct Document;

struct Token;

impl Modify for Token {
    fn modify(&self, document: &mut utoipa::openapi::OpenApi) {
        let scheme = SecurityScheme::Http(HttpBuilder::new().scheme(HttpAuthScheme::Bearer).build());
        document.components.get_or_insert_default().add_security_scheme("token", scheme);
    }
}

/// Version and state of the program.
#[derive(Serialize, ToSchema)]
struct About {
    version: &'static str,
    /// Whether the whole bench is simulated.
    simulated: bool,
    /// Problems of the service with their remedies, such as a full disk; empty if there are none.
    problems: Vec<String>,
}

/// Reads version and state of the program.
#[utoipa::path(get, path = "/api/v1/about", tag = "service", operation_id = "about",
    responses((status = 200, body = About)))]
async fn about(State(app): State<Arc<App>>) -> Json<About> {
    Json(About { version: env!("CARGO_PKG_VERSION"), simulated: app.simulated, problems: app.stores.problems() })
}

fn api() -> OpenApiRouter<Arc<App>> {
    OpenApiRouter::with_openapi(Document::openapi())
        .routes(routes!(about))
        .routes(routes!(settings::get, settings::save))
        .routes(routes!(settings::schema))
        .routes(routes!(settings::check))
        .routes(routes!(devices::state))
        .routes(routes!(devices::move_stage))
        .routes(routes!(devices::home_stage))
        .routes(routes!(devices::show))
        .routes(routes!(devices::set_camera))
        .routes(routes!(devices::meter_camera))
        .routes(routes!(devices::switch_flash))
        .routes(routes!(measure::begin))
        .routes(routes!(measure::state))
        .routes(routes!(preview::preview))
        .routes(routes!(preview::preview_picture))
        .routes(routes!(devices::stop))
        .routes(routes!(plans::schema))
        .routes(routes!(plans::check))
        .routes(routes!(plans::estimate))
        .routes(routes!(samples::list))
        .routes(routes!(samples::picture))
        .routes(routes!(samples::photographs))
        .routes(routes!(samples::begin))
        .routes(routes!(sessions::begin, sessions::list))
        .routes(routes!(sessions::get, naming::session, deletion::session))
        .routes(routes!(sessions::pause))
        .routes(routes!(sessions::resume))
        .routes(routes!(sessions::stop))
        .routes(routes!(sessions::abort))
        .routes(routes!(sessions::session_events))
        .routes(routes!(session_data::frames))
        .routes(routes!(session_data::frame))
        .routes(routes!(session_data::live))
        .routes(routes!(deletion::of_session))
        .routes(routes!(session_data::files))
        .routes(routes!(operations::list))
        .routes(routes!(operations::run))
        .routes(routes!(reconstructions::begin, reconstructions::list))
        .routes(routes!(reconstructions::estimate))
        .routes(routes!(reconstructions::get, naming::reconstruction, deletion::reconstruction))
        .routes(routes!(deletion::of_reconstruction))
        .routes(routes!(reconstructions::cancel))
        .routes(routes!(reconstructions::finish))
        .routes(routes!(reconstructions::retry))
        .routes(routes!(reconstructions::log))
        .routes(routes!(reconstructions::job_events))
        .routes(routes!(queue::list))
        .routes(routes!(queue::first))
        .routes(routes!(renders::picture))
        .routes(routes!(results::list))
        .routes(routes!(results::file))
        .routes(routes!(map_list::list))
        .routes(routes!(results::map))
        .routes(routes!(tiles::tile))
        .routes(routes!(map_regions::statistics))
        .routes(routes!(map_regions::profile))
        .routes(routes!(results::pixel))
        .routes(routes!(uploads::angles))
        .routes(routes!(scene_editing::schema))
        .routes(routes!(scene_editing::read, scene_editing::check))
        .routes(routes!(scene_editing::draft))
        .routes(routes!(stored_uploads::list))
        .routes(routes!(naming::upload, deletion::upload))
        .routes(routes!(deletion::of_upload))
        .routes(routes!(calibrations::keep, calibrations::list))
        .routes(routes!(calibrations::get, calibrations::delete))
        .routes(routes!(calibrations::deletion))
        .routes(routes!(calibrations::list_files))
        .routes(routes!(calibrations::file))
        .routes(routes!(trash::list, trash::empty))
        .routes(routes!(trash::delete))
        .routes(routes!(trash::restore))
        .routes(routes!(view::view))
        .routes(routes!(view::file))
        .routes(routes!(charts::list))
        .routes(routes!(charts::file))
        .routes(routes!(deletion::charts_folder))
        .routes(routes!(deletion::of_charts))
        .routes(routes!(display::state))
        .routes(routes!(display::show))
        .routes(routes!(display::link))
        .routes(routes!(display::acknowledge))
        .routes(routes!(display::beat))
}

/// Routes of uploads, without limits of time and body size: uploads have their own limits.
fn slow() -> OpenApiRouter<Arc<App>> {
    OpenApiRouter::new().routes(routes!(uploads::upload)).layer(DefaultBodyLimit::disable())
}

/// The OpenAPI document of the service.
pub fn openapi() -> Value {
    let mut document = serde_json::to_value(documented()).unwrap_or_default();
    operations::describe(&mut document);
    let operations = document["paths"].as_object_mut().into_iter().flat_map(|paths| paths.values_mut());
    for operation in operations.filter_map(Value::as_object_mut).flat_map(|item| item.values_mut()) {
        if let Some(responses) = operation.get_mut("responses").and_then(Value::as_object_mut) {
            // Every request can be refused with these statuses.
            for (status, why) in REFUSALS {
                responses.entry(*status).or_insert_with(|| json!({ "description": why }));
            }
            for (status, response) in responses.iter_mut() {
                let why = REFUSALS.iter().find(|r| r.0 == status).map_or("Done", |r| r.1);
                if response["description"].as_str().unwrap_or_default().is_empty() {
                    response["description"] = json!(why);
                }
            }
            let refused = responses.iter_mut().filter(|(status, _)| status.as_str() >= "400");
            for (_, response) in refused {
                let schema = json!({ "$ref": "#/components/schemas/Problem" });
                response["content"] = json!({ "application/problem+json": { "schema": schema } });
            }
        }
    }
    document
}

/// Error statuses of every operation, with their descriptions.
const REFUSALS: &[(&str, &str)] = &[
    ("400", "Something in the request cannot be used"),
    ("401", "A token is needed"),
    ("403", "The token's role does not allow it, or the request comes from elsewhere"),
    ("404", "Not found"),
    ("408", "The request came too slowly"),
    ("409", "It does not fit the state"),
    ("412", "It was changed meanwhile"),
    ("413", "The request is too large"),
    ("429", "Too many requests at once"),
    ("503", "The system does not allow it now: too many files are open, or the disk is read-only"),
    ("507", "The disk is full"),
];

fn documented() -> utoipa::openapi::OpenApi {
    let mut document = api().merge(slow()).to_openapi();
    // axum's wildcard for the rest of a path is one parameter in OpenAPI.
    let path = "/api/v1/sessions/{id}/files/{path}";
    let file = OpenApiRouter::<Arc<App>>::new().routes(routes!(session_data::file)).to_openapi();
    if let Some(item) = file.paths.paths.get(path) {
        document.paths.paths.insert(path.into(), item.clone());
    }
    document
}

/// The service as a router.
pub fn router(app: &Arc<App>) -> Router {
    let body = app.config().limits.body_kib << 10;
    let (quick, _) = api().split_for_parts();
    let (slow, _) = slow().split_for_parts();
    let document = serde_json::to_string(&openapi()).unwrap_or_default();
    let json = move || async move { ([(header::CONTENT_TYPE, "application/json")], document) };
    quick
        .route("/api/v1/sessions/{id}/files/{*path}", get(session_data::file))
        .route("/api/v1/openapi.json", get(json))
        .route("/healthz", get(health))
        .route("/readyz", get(ready))
        .route("/metrics", get(numbers))
        .route("/", get(|headers| page("/".into(), headers)))
        .route("/display", get(|headers| page("/display".into(), headers)))
        .route("/assets/{*path}", get(|Path(path): Path<String>, headers| page(format!("/assets/{path}"), headers)))
        .layer(middleware::from_fn_with_state(app.clone(), bounded))
        .layer(DefaultBodyLimit::max(body))
        .layer(middleware::from_fn_with_state(app.clone(), in_time))
        .merge(slow)
        .fallback(|| async { Problem::not_found("such path") })
        .method_not_allowed_fallback(|| async { Problem::new(Kind::Method, "this path takes another method") })
        .layer(CompressionLayer::new().compress_when(SizeAbove::default().and(is_text)))
        .layer(middleware::from_fn(connections::in_pace))
        .layer(middleware::from_fn_with_state(app.clone(), access::check))
        .layer(middleware::from_fn_with_state(app.clone(), count))
        .with_state(app.clone())
}

async fn numbers(State(app): State<Arc<App>>) -> Response {
    let open = app.config().limits.subscribers - app.subscribers.available_permits();
    ([(header::CONTENT_TYPE, "application/openmetrics-text; version=1.0.0; charset=utf-8")], app.metrics.text(open))
        .into_response()
}

/// Liveness check: answers even if the service has problems.
async fn health(State(app): State<Arc<App>>) -> String {
    let problems = app.stores.problems();
    if problems.is_empty() { "ok".into() } else { problems.join("\n") }
}

/// Readiness check: fails while the service has problems.
async fn ready(State(app): State<Arc<App>>) -> Answer<&'static str> {
    app.jobs().map(|_| "ok")
}

/// A document of the page, or one of its files. Browsers keep files whose path contains the page's version.
async fn page(path: String, headers: HeaderMap) -> Response {
    const FOR_EVER: &str = "public, max-age=31536000, immutable";
    if let Some(document) = nacre_web::document(&path) {
        return Html(document).into_response();
    }
    let Some(file) = nacre_web::versioned(&path) else {
        return match nacre_web::asset(&path) {
            Some(asset) => {
                let headers = [(header::CONTENT_TYPE, asset.content_type), (header::CACHE_CONTROL, "no-cache")];
                (headers, asset.bytes).into_response()
            }
            None => Problem::not_found("such page").into_response(),
        };
    };
    let kept = [
        (header::CONTENT_TYPE, file.asset.content_type),
        (header::CACHE_CONTROL, FOR_EVER),
        (header::VARY, "accept-encoding"),
    ];
    match takes_gzip(&headers) {
        true => (kept, [(header::CONTENT_ENCODING, "gzip")], file.gzip.as_slice()).into_response(),
        false => (kept, file.asset.bytes).into_response(),
    }
}

/// Whether a client accepts gzip with any weight but zero.
fn takes_gzip(headers: &HeaderMap) -> bool {
    let values = headers.get_all(header::ACCEPT_ENCODING).iter().filter_map(|value| value.to_str().ok());
    values.flat_map(|value| value.split(',')).any(|coding| {
        let (name, weight) = coding.split_once(';').unwrap_or((coding, ""));
        let weight = weight.trim().trim_start_matches("q=");
        name.trim().eq_ignore_ascii_case("gzip") && (weight.is_empty() || weight.parse().is_ok_and(|q: f64| q > 0.0))
    })
}

/// Whether to compress an answer: text only. Events must not be delayed, pictures are already compressed, and maps
/// take too long.
fn is_text(_: StatusCode, _: Version, headers: &HeaderMap, _: &Extensions) -> bool {
    const TEXT: [&str; 6] =
        ["text/html", "text/css", "text/javascript", "image/svg+xml", "application/json", "application/problem+json"];
    let kind = headers.get(header::CONTENT_TYPE).and_then(|value| value.to_str().ok()).unwrap_or_default();
    TEXT.iter().any(|text| kind.starts_with(text))
}

/// Ends requests that exceed the time limit.
async fn in_time(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let longest = Duration::from_secs(app.config().limits.request_s);
    match tokio::time::timeout(longest, next.run(request)).await {
        Ok(response) => response,
        Err(_) => Problem::new(Kind::Conflict, "the request took too long").into_response(),
    }
}

/// Refuses simultaneous requests beyond the limit; requests whose body is still arriving do not count. STOP is never
/// refused, and needs no body.
async fn bounded(
    State(app): State<Arc<App>>,
    Extension(activity): Extension<Arc<Activity>>,
    request: Request,
    next: Next,
) -> Response {
    if request.uri().path() == "/api/v1/stop" {
        let _work = activity.work();
        return next.run(request).await;
    }
    let (parts, body) = request.into_parts();
    let body = match Bytes::from_request(Request::from_parts(parts.clone(), body), &()).await {
        Ok(body) => body,
        Err(rejection) => return Problem::from(rejection).into_response(),
    };
    let _work = activity.work();
    let Ok(_place) = app.requests.try_acquire() else {
        let most = app.config().limits.requests;
        let refused = Problem::new(Kind::TooMany, format!("{most} requests are being answered"));
        return refused.remedy("try again").into_response();
    };
    next.run(Request::from_parts(parts, body.into())).await
}

/// Counts answers by status.
async fn count(State(app): State<Arc<App>>, request: Request, next: Next) -> Response {
    let response = next.run(request).await;
    app.metrics.answered(response.status().as_u16());
    if response.status() == StatusCode::INTERNAL_SERVER_ERROR {
        tracing::error!("a request was answered with 500");
    }
    response
}
