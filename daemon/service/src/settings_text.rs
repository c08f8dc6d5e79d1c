//! Changes of a configuration as TOML text. Comments and the order of keys are kept.

use serde_json::{Map, Value};
use toml_edit::{Array, ArrayOfTables, DocumentMut, InlineTable, Item, Table, TableLike};

/// Values that a text gives.
///
/// # Errors
/// The problem with its line.
pub fn values(text: &str) -> Result<Value, String> {
    let table: toml::Table = nacre_base::text::from_toml(text)?;
    serde_json::to_value(table).map_err(|e| e.to_string())
}

/// The text with other values: keys that are not in `wanted` are removed, unless they give the default.
///
/// # Errors
/// The problem of the text, with its line.
pub fn with_values(text: &str, wanted: &Map<String, Value>, defaults: &Value) -> Result<String, String> {
    let had = values(text)?;
    let mut document: DocumentMut = text.parse().map_err(|e: toml_edit::TomlError| e.to_string())?;
    change(document.as_table_mut(), &had, wanted, defaults);
    Ok(document.to_string())
}

fn change(table: &mut dyn TableLike, had: &Value, wanted: &Map<String, Value>, defaults: &Value) {
    for (key, value) in had.as_object().into_iter().flatten() {
        if !wanted.contains_key(key) && !same(value, &defaults[key]) {
            table.remove(key);
        }
    }
    for (key, value) in wanted.iter().filter(|(key, value)| !same(value, &had[key.as_str()])) {
        let before = table.get_mut(key);
        match (before, value) {
            (Some(Item::Value(before)), value) if !value.is_object() => {
                let Some(mut next) = plain(value) else { continue };
                *next.decor_mut() = before.decor().clone();
                *before = next;
            }
            (Some(before), Value::Object(wanted)) if before.is_table_like() => {
                if let Some(inner) = before.as_table_like_mut() {
                    change(inner, &had[key], wanted, &defaults[key]);
                }
            }
            _ => {
                if let Some(item) = item(value) {
                    table.insert(key, item);
                }
            }
        }
    }
}

/// Whether two values are equal; 10 and 10.0 are.
fn same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Number(a), Value::Number(b)) => a.as_f64() == b.as_f64(),
        (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| same(a, b)),
        _ => a == b,
    }
}

/// A value as tables where TOML has them; `None` for null.
fn item(value: &Value) -> Option<Item> {
    match value {
        Value::Object(map) => Some(Item::Table(table(map))),
        Value::Array(all) if !all.is_empty() && all.iter().all(Value::is_object) => {
            let tables = all.iter().filter_map(|one| one.as_object().map(table));
            Some(Item::ArrayOfTables(tables.collect::<ArrayOfTables>()))
        }
        _ => plain(value).map(Item::Value),
    }
}

fn table(map: &Map<String, Value>) -> Table {
    map.iter().filter_map(|(key, value)| Some((key, item(value)?))).collect()
}

/// A value on one line; `None` for null.
fn plain(value: &Value) -> Option<toml_edit::Value> {
    Some(match value {
        Value::Null => return None,
        Value::Bool(flag) => (*flag).into(),
        Value::String(text) => text.into(),
        Value::Number(number) => match (number.as_i64(), number.as_f64()) {
            (Some(whole), _) => whole.into(),
            (None, real) => real.unwrap_or_default().into(),
        },
        Value::Array(all) => all.iter().filter_map(plain).collect::<Array>().into(),
        Value::Object(map) => {
            map.iter().filter_map(|(key, value)| Some((key, plain(value)?))).collect::<InlineTable>().into()
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    const TEXT: &str = "# Bench of room 3\nlisten = \"127.0.0.1:8465\" # here only\nhosts = [\"a\"]\n\n[limits]\n\
                        requests = 64\nupload_mib = 10 # small disk\n\n[[tokens]]\nname = \"anna\"\n";

    #[test]
    fn only_changed_keys_are_rewritten() {
        let defaults = json!({ "limits": { "requests": 64 } });
        let changed = |wanted: Value| with_values(TEXT, wanted.as_object().unwrap(), &defaults).unwrap();
        let mut same = values(TEXT).unwrap();
        same["limits"]["upload_mib"] = json!(10.0);
        assert_eq!(changed(same.clone()), TEXT);
        same["limits"]["upload_mib"] = json!(20);
        assert_eq!(changed(same.clone()), TEXT.replace("10 #", "20 #"));
        same["limits"] = json!({ "upload_mib": 10, "trash_days": 3 });
        assert_eq!(changed(same.clone()), TEXT.replace("# small disk\n", "# small disk\ntrash_days = 3\n"));
        same.as_object_mut().unwrap().remove("hosts");
        same["bench"] = json!({ "stage": { "driver": { "kind": "hand" } }, "flash": null });
        let text = changed(same.clone());
        assert!(text.starts_with("# Bench of room 3\nlisten = \"127.0.0.1:8465\" # here only\n"), "{text}");
        let mut wanted = same.clone();
        wanted["bench"].as_object_mut().unwrap().remove("flash");
        wanted["limits"]["requests"] = json!(64);
        assert_eq!(values(&text).unwrap(), wanted, "{text}");
        same["tokens"] = json!([{ "name": "anna" }, { "name": "ben" }]);
        assert!(changed(same).contains("[[tokens]]\nname = \"ben\""));
    }

    #[test]
    fn a_problem_has_its_line() {
        let problem = with_values("a = 1\nb = [", &Map::new(), &Value::Null).unwrap_err();
        assert!(problem.contains("line 2"), "{problem}");
    }
}
