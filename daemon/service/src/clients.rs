//! Schemas in the forms that generators of clients accept.
//!
//! openapi-python-client tries only the first of several constant words, and loses objects that are described within
//! alternatives. Words therefore become enumerations, and such objects get names.

use serde_json::{Map, Value, json};

/// Rewrites all schemas of an OpenAPI document without changing the values that they accept.
pub fn simplify(schemas: &mut Map<String, Value>) {
    schemas.values_mut().for_each(enumerate);
    let mut named = Map::new();
    for (name, schema) in schemas.iter_mut() {
        let alternatives = schema.get_mut("oneOf").and_then(Value::as_array_mut);
        for alternative in alternatives.into_iter().flatten() {
            let key = alternative["required"][0].as_str().map(|key| name.clone() + &pascal(key));
            if let Some(own) = key.filter(|_| alternative["type"] == "object") {
                let reference = json!({ "$ref": format!("#/components/schemas/{own}") });
                named.insert(own, std::mem::replace(alternative, reference));
            }
        }
    }
    for (name, schema) in named {
        debug_assert!(!schemas.contains_key(&name), "two schemas are called {name}");
        schemas.insert(name, schema);
    }
}

/// `per_mm` as `PerMm`.
fn pascal(key: &str) -> String {
    let capital = |word: &str| word[..1].to_uppercase() + &word[1..];
    key.split('_').filter(|word| !word.is_empty()).map(capital).collect()
}

/// Rewrites a constant word, or alternatives that are words, as an enumeration with the words' meanings.
fn enumerate(schema: &mut Value) {
    match schema {
        Value::Object(node) => {
            if let Some(Value::String(word)) = node.get("const") {
                let words = json!([word]);
                node.remove("const");
                node.insert("enum".into(), words);
            }
            node.values_mut().for_each(enumerate);
            let words = node.get("oneOf").and_then(Value::as_array).and_then(|all| words(all));
            if let Some((words, meanings)) = words {
                node.remove("oneOf");
                let described = node.get("description").and_then(Value::as_str).map(str::to_owned);
                let text = described.into_iter().chain(meanings).collect::<Vec<_>>().join("\n\n");
                node.insert("type".into(), json!("string"));
                node.insert("enum".into(), words.into());
                if !text.is_empty() {
                    node.insert("description".into(), text.into());
                }
            }
        }
        Value::Array(all) => all.iter_mut().for_each(enumerate),
        _ => {}
    }
}

/// Words of the alternatives and a list of their meanings, if all alternatives are words.
fn words(alternatives: &[Value]) -> Option<(Vec<Value>, Option<String>)> {
    let (mut words, mut meanings) = (vec![], vec![]);
    for alternative in alternatives {
        let own = alternative["enum"].as_array().filter(|all| all.iter().all(Value::is_string))?;
        words.extend(own.iter().cloned());
        if let ([Value::String(word)], Some(meaning)) = (own.as_slice(), alternative["description"].as_str()) {
            meanings.push(format!("- `{word}`: {meaning}"));
        }
    }
    Some((words, Some(meanings.join("\n")).filter(|list| !list.is_empty())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_become_enumerations_and_objects_get_names() {
        let mut schemas = Map::new();
        let model = json!([{ "const": "plain", "type": "string", "description": "Phase." }, { "enum": ["circle"] }]);
        schemas.insert("Model".into(), json!({ "oneOf": model, "description": "Model." }));
        let pixel = json!({ "type": "object", "required": ["pixel_um"], "properties": { "pixel_um": {} } });
        schemas.insert("Scale".into(), json!({ "oneOf": [{ "const": "unknown" }, pixel] }));
        simplify(&mut schemas);
        assert_eq!(
            schemas["Model"],
            json!({ "type": "string", "enum": ["plain", "circle"], "description": "Model.\n\n- `plain`: Phase." })
        );
        let reference = json!({ "$ref": "#/components/schemas/ScalePixelUm" });
        assert_eq!(schemas["Scale"], json!({ "oneOf": [{ "enum": ["unknown"] }, reference] }));
        assert_eq!(schemas["ScalePixelUm"], pixel);
    }
}
