//! Parsing of option values from text.

use super::{BARE, LIST, NAMELESS, SHORT, is_set};
use serde_json::{Map, Value};

/// Words of a schema that accepts only words.
pub(super) fn words(schema: &Map<String, Value>) -> Option<Vec<String>> {
    if let Some(word) = schema.get("const") {
        return Some(vec![word.as_str()?.to_owned()]);
    }
    if let Some(Value::Array(all)) = schema.get("enum") {
        return all.iter().map(|word| word.as_str().map(str::to_owned)).collect();
    }
    let Some(Value::Array(all)) = schema.get("oneOf") else { return None };
    let each = all.iter().map(|one| words(one.as_object()?));
    Some(each.collect::<Option<Vec<_>>>()?.concat())
}

/// Parses a text according to a schema.
pub(super) fn read(schema: &Map<String, Value>, text: &str) -> Option<Value> {
    if let Some(words) = words(schema) {
        let same = |word: &&String| word.replace('_', "-") == text.replace('_', "-");
        return words.iter().find(same).map(|word| Value::from(word.as_str()));
    }
    for key in ["oneOf", "anyOf"] {
        if let Some(Value::Array(all)) = schema.get(key) {
            return all.iter().filter_map(Value::as_object).find_map(|one| read(one, text));
        }
    }
    match schema.get("type").and_then(Value::as_str)? {
        "string" => Some(text.into()),
        "boolean" => text.parse::<bool>().ok().map(Value::from),
        "integer" => text.parse::<i64>().ok().map(Value::from),
        "number" => text.parse::<f64>().ok().filter(|v| v.is_finite()).map(Value::from),
        "array" => {
            let mut parts = parts(text).into_iter();
            let list = filled(schema, &mut parts)?;
            parts.next().is_none().then_some(list)
        }
        "object" if is_set(schema, LIST) => listed(schema, text),
        "object" => named(schema, text),
        _ => None,
    }
}

/// Splits a list.
fn parts(text: &str) -> Vec<&str> {
    text.split([',', ':', ';', 'x', '×']).map(str::trim).collect()
}

/// Parses a structure whose values are listed in the order of its keys.
fn listed(schema: &Map<String, Value>, text: &str) -> Option<Value> {
    let (properties, parts) = (schema.get("properties")?.as_object()?, parts(text));
    if parts.len() != properties.len() {
        return None;
    }
    let each =
        properties.iter().zip(parts).map(|((key, own), part)| Some((key.clone(), read(own.as_object()?, part)?)));
    each.collect::<Option<Map<_, _>>>().map(Value::Object)
}

/// Builds a list, and lists nested in it, from the next parts.
fn filled<'a>(schema: &Map<String, Value>, parts: &mut impl ExactSizeIterator<Item = &'a str>) -> Option<Value> {
    if schema.get("type").and_then(Value::as_str) != Some("array") {
        return read(schema, parts.next()?);
    }
    let count = |key: &str| schema.get(key).and_then(Value::as_u64);
    let count = count("minItems").filter(|n| count("maxItems") == Some(*n))?;
    let each = schema.get("items")?.as_object()?;
    let usual = schema.get("default").filter(|_| is_set(schema, SHORT));
    let next = |k: u64| match parts.len() {
        0 if k > 0 => usual?.get(k as usize).cloned(),
        _ => filled(each, parts),
    };
    (0..count).map(next).collect::<Option<Vec<_>>>().map(Value::from)
}

/// Parses a variant with a value: `name=value`, or its name alone for the default value.
fn named(schema: &Map<String, Value>, text: &str) -> Option<Value> {
    let (key, inner) = schema.get("properties")?.as_object()?.iter().next()?;
    if is_set(schema, NAMELESS)
        && let Some(value) = read(inner.as_object()?, text)
    {
        return Some(Value::Object(Map::from_iter([(key.clone(), value)])));
    }
    let (name, value) = text.split_once('=').map_or((text, None), |(name, value)| (name, Some(value)));
    if name.replace('-', "_") != key.replace('-', "_") {
        return None;
    }
    let value = match value {
        Some(value) => read(inner.as_object()?, value)?,
        None => schema.get(BARE)?.clone(),
    };
    Some(Value::Object(Map::from_iter([(key.clone(), value)])))
}
