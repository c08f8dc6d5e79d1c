//! `/api/v1/settings`: the configuration of the service, its file and its changes.

use super::config::{Config, Source};
use super::problem::{Answer, Kind, Problem};
use super::settings_text::{values, with_values};
use super::{App, Body, blocking};
use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use nacre_base::Error;
use nacre_base::rewrite;
use nacre_capture::session::sha256;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use utoipa::ToSchema;

/// Keys that take effect when they are saved. All others do so after a restart.
const AT_ONCE: [&str; 7] = [
    "hosts",
    "tokens",
    "calibration.max_age_days",
    "limits.upload_mib",
    "limits.upload_days",
    "limits.trash_days",
    "limits.request_s",
];

/// Largest configuration in bytes.
const LIMIT: u64 = 1 << 20;

/// The file of the configuration, and the state of its changes.
#[derive(Debug, Default)]
pub struct Settings {
    source: Mutex<Source>,
    /// Locked while the file is compared and written.
    turn: tokio::sync::Mutex<()>,
}

impl Settings {
    /// Settings of a service that runs with a configuration from this source.
    pub fn new(source: Source) -> Self {
        Self { source: Mutex::new(source), turn: tokio::sync::Mutex::default() }
    }

    fn source(&self) -> Source {
        self.source.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// A key whose value differs.
#[derive(Debug, PartialEq, Serialize, ToSchema)]
pub struct SettingsChange {
    /// The key, such as `limits.trash_days`.
    key: String,
    /// Value in use.
    from: Value,
    /// Value of the text.
    to: Value,
    /// Whether it takes effect when it is saved, or after a restart.
    at_once: bool,
}

/// A configuration as text, with its effects.
#[derive(Debug, Serialize, ToSchema)]
pub struct CheckedSettings {
    /// TOML text.
    text: String,
    /// Values that the text gives; null if it cannot be read.
    #[schema(value_type = Option<Object>)]
    values: Value,
    /// Reason why it cannot be used.
    problem: Option<String>,
    /// Differences from the configuration in use.
    changes: Vec<SettingsChange>,
}

/// The configuration file, with its effects.
#[derive(Debug, Serialize, ToSchema)]
pub struct SettingsDoc {
    /// Its path on the machine of the service.
    file: String,
    /// Whether the file exists.
    exists: bool,
    #[serde(flatten)]
    checked: CheckedSettings,
    /// Keys that options of the command line or limits of the machine override, with their values in use as `to`.
    overridden: Vec<SettingsChange>,
    /// Name of the copy of the file before this change.
    #[serde(skip_serializing_if = "Option::is_none")]
    backup: Option<String>,
}

/// A text to check, or to change first.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SettingsDraft {
    /// TOML text.
    text: String,
    /// Values that replace those of the text; its comments are kept.
    #[serde(default)]
    #[schema(value_type = Option<Object>)]
    values: Option<Map<String, Value>>,
}

/// Reads the configuration file, and its differences from the configuration in use.
#[utoipa::path(get, path = "/api/v1/settings", tag = "service", operation_id = "settings",
    responses((status = 200, body = SettingsDoc, headers(("ETag" = String, description = "Version of the file")))))]
pub async fn get(State(app): State<Arc<App>>) -> Answer<Response> {
    let source = app.settings.source();
    blocking(move || document(&app, &source, None)).await
}

/// Reads the JSON Schema of the configuration.
#[utoipa::path(get, path = "/api/v1/settings/schema", tag = "service", operation_id = "settings_schema",
    responses((status = 200, body = Object)))]
pub async fn schema() -> Json<Value> {
    Json(json!(schemars::schema_for!(Config)))
}

/// Checks a configuration without saving it.
#[utoipa::path(post, path = "/api/v1/settings/check", tag = "service", operation_id = "check_settings",
    request_body = SettingsDraft, responses((status = 200, body = CheckedSettings), (status = 400, body = Problem)))]
pub async fn check(State(app): State<Arc<App>>, Body(draft): Body<SettingsDraft>) -> Answer<Json<CheckedSettings>> {
    let text = match &draft.values {
        Some(wanted) => with_values(&draft.text, wanted, &json!(Config::default())).map_err(Problem::bad)?,
        None => draft.text,
    };
    Ok(Json(checked(&app, text).0))
}

/// Saves the configuration, with a copy of the file before. Needs the version of the file in `If-Match`.
#[utoipa::path(put, path = "/api/v1/settings", tag = "service", operation_id = "save_settings",
    request_body = SettingsDraft, params(("If-Match" = String, Header, description = "ETag of the file that was changed")),
    responses((status = 200, body = SettingsDoc), (status = 400, body = Problem), (status = 412, body = Problem)))]
pub async fn save(
    State(app): State<Arc<App>>,
    headers: HeaderMap,
    Body(draft): Body<SettingsDraft>,
) -> Answer<Response> {
    let Some(version) = headers.get(header::IF_MATCH).and_then(|value| value.to_str().ok()).map(str::to_owned) else {
        return Err(Problem::bad("the header If-Match is missing").remedy("give the ETag of the configuration"));
    };
    let text = check(State(app.clone()), Body(draft)).await?.0.text;
    let (checked, config) = checked(&app, text);
    let Some(config) = config else { return Err(Problem::bad(checked.problem.unwrap_or_default())) };
    let source = app.settings.source();
    let _turn = app.settings.turn.lock().await;
    let (saved, place) = (app.clone(), source.clone());
    blocking(move || {
        let backup = write(&place.file, &version, &checked.text)?;
        saved.apply(&config);
        document(&saved, &saved.settings.source(), backup)
    })
    .await
}

impl App {
    /// Puts the keys into effect that need no restart.
    fn apply(&self, config: &Config) {
        let mut source = self.settings.source.lock().unwrap_or_else(PoisonError::into_inner);
        source.read = taking_over(&source.read, config);
        let mut running = self.config.write().unwrap_or_else(PoisonError::into_inner);
        *running = Arc::new(taking_over(&running, config));
    }
}

/// A configuration with the values of another one for the keys that take effect at once.
fn taking_over(config: &Config, other: &Config) -> Config {
    let (mut now, next) = (json!(config), json!(other));
    for key in AT_ONCE {
        let pointer = format!("/{}", key.replace('.', "/"));
        match (now.pointer_mut(&pointer), next.pointer(&pointer)) {
            (Some(place), Some(value)) => *place = value.clone(),
            // Keys of the first level are left out if they are empty.
            _ => now[key] = next.get(key).cloned().unwrap_or_else(|| json!([])),
        }
    }
    serde_json::from_value(now).unwrap_or_else(|_| config.clone())
}

/// A text with its problem or its configuration.
fn checked(app: &App, text: String) -> (CheckedSettings, Option<Config>) {
    let running = app.config();
    let read = Config::of(Some(&text)).and_then(|config| {
        // The address may be that of an option of the command line.
        let here = Config { listen: running.listen, ..config.clone() };
        config.check_access().and_then(|()| here.check_access()).map_err(|e| e.to_string())?;
        Ok(config)
    });
    let values = values(&text).unwrap_or_default();
    match read {
        Ok(config) => {
            let changes = differences(&app.settings.source().read, &config);
            (CheckedSettings { text, values, problem: None, changes }, Some(config))
        }
        Err(problem) => (CheckedSettings { text, values, problem: Some(problem), changes: vec![] }, None),
    }
}

fn document(app: &App, source: &Source, backup: Option<String>) -> Answer<Response> {
    let bytes = read(&source.file)?;
    let etag = version(bytes.as_deref());
    let exists = bytes.is_some();
    let text =
        String::from_utf8(bytes.unwrap_or_default()).map_err(|_| Problem::bad("the configuration is no text"))?;
    let (checked, _) = checked(app, text);
    let overridden = differences(&source.read, &app.config());
    let file = source.file.display().to_string();
    Ok(([(header::ETAG, etag)], Json(SettingsDoc { file, exists, checked, overridden, backup })).into_response())
}

/// Bytes of the file, `None` if it does not exist.
fn read(file: &Path) -> Answer<Option<Vec<u8>>> {
    match fs::metadata(file) {
        Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
        Err(e) => Err(Problem::refused("the configuration cannot be read", &e)),
        Ok(found) if !found.is_file() || found.len() > LIMIT => {
            Err(Problem::bad("the configuration is no regular file of up to 1 MiB"))
        }
        Ok(_) => fs::read(file).map(Some).map_err(|e| Problem::refused("the configuration cannot be read", &e)),
    }
}

fn version(bytes: Option<&[u8]>) -> String {
    bytes.map_or_else(|| "\"none\"".into(), |bytes| format!("\"{:.16}\"", sha256(bytes)))
}

/// Writes the file whole, if it still has this version. Returns the name of the copy of the old one.
fn write(file: &Path, expected: &str, text: &str) -> Answer<Option<String>> {
    let before = read(file)?;
    if version(before.as_deref()) != expected {
        return Err(Problem::new(Kind::Outdated, "the configuration was changed meanwhile")
            .remedy("read it again, and repeat the change; nothing was saved"));
    }
    let failed = |error: Error| {
        let remedy = "copy the text and save it as the file of the configuration, or let the service write that file";
        Problem::from(error).remedy(remedy)
    };
    let put = |path: &Path, bytes: &[u8]| {
        rewrite(path, |to| fs::write(to, bytes).map_err(|e| Error::output(path, e))).map_err(failed)
    };
    let backup = before.map(|bytes| {
        // The name depends on the content, so that no older copy is overwritten.
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let name = format!("{name}.{:.8}.bak", sha256(&bytes));
        let copy = file.with_file_name(&name);
        if copy.exists() { Ok(name) } else { put(&copy, &bytes).map(|()| name) }
    });
    let backup = backup.transpose()?;
    put(file, text.as_bytes())?;
    Ok(backup)
}

/// Keys whose values differ between two configurations.
fn differences(from: &Config, to: &Config) -> Vec<SettingsChange> {
    let [before, after] = [from, to].map(|config| {
        let mut keys = BTreeMap::new();
        leaves("", json!(config), &mut keys);
        keys
    });
    let keys = before.keys().chain(after.keys().filter(|key| !before.contains_key(*key)));
    let value = |keys: &BTreeMap<String, Value>, key: &String| keys.get(key).cloned().unwrap_or_default();
    let changes = keys.map(|key| SettingsChange {
        key: key.clone(),
        from: value(&before, key),
        to: value(&after, key),
        at_once: AT_ONCE.contains(&key.as_str()),
    });
    changes.filter(|change| change.from != change.to).collect()
}

/// Collects the values of an object by their keys; lists are single values.
fn leaves(key: &str, value: Value, keys: &mut BTreeMap<String, Value>) {
    match value {
        Value::Object(map) if !map.is_empty() => {
            let dot = if key.is_empty() { "" } else { "." };
            map.into_iter().for_each(|(name, inner)| leaves(&format!("{key}{dot}{name}"), inner, keys));
        }
        value => drop(keys.insert(key.to_owned(), value)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn some_keys_take_effect_at_once() {
        let text = "hosts = [\"a.lab\"]\nlisten = \"127.0.0.1:1\"\n[limits]\ntrash_days = 1\nrequests = 2\n[bench]\nsim = true\n\
                    [[tokens]]\nname = \"a\"\nrole = \"view\"\nsha256 = \"";
        let text = format!("{text}{}\"\n", "0".repeat(64));
        let (before, next) = (Config::default(), Config::of(Some(&text)).unwrap());
        let changed = differences(&before, &next);
        let keys =
            |at_once| changed.iter().filter(|c| c.at_once == at_once).map(|c| c.key.as_str()).collect::<Vec<_>>();
        assert_eq!(keys(true), ["hosts", "limits.trash_days", "tokens"]);
        assert_eq!(keys(false), ["bench.sim", "limits.requests", "listen"]);
        let now = taking_over(&before, &next);
        assert_eq!((now.tokens.len(), now.limits.trash_days, now.limits.requests), (1, 1, 64));
        assert!(differences(&now, &next).iter().all(|change| !change.at_once));
        // Removed keys have their defaults again.
        let back = taking_over(&now, &before);
        assert_eq!(back, before);
    }

    #[test]
    fn a_file_changed_meanwhile_is_not_overwritten() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("nacre.toml");
        assert_eq!(write(&file, "\"none\"", "a = 1").unwrap(), None);
        let refused = write(&file, "\"none\"", "a = 2").unwrap_err();
        assert!(refused.detail().contains("changed meanwhile"));
        let backup = write(&file, &version(Some(b"a = 1")), "a = 2").unwrap().unwrap();
        assert_eq!(fs::read_to_string(dir.path().join(&backup)).unwrap(), "a = 1");
        assert_eq!(fs::read_to_string(&file).unwrap(), "a = 2");
        let other = write(&file, &version(Some(b"a = 2")), "a = 1").unwrap().unwrap();
        assert_ne!(backup, other);
        write(&file, &version(Some(b"a = 1")), "a = 3").unwrap();
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 3);
    }
}
