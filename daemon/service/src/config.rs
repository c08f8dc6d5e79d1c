//! `nacre.toml`: configuration of the service. Environment variables `NACRE_SERVE_…` override it.

use super::access::Address;
use figment::Figment;
use figment::error::Kind;
use figment::providers::{Env, Serialized};
use nacre_base::text::{from_toml, read_text};
use nacre_base::{Error, Version};
use nacre_capture::calibrations::MAX_AGE_DAYS;
use nacre_capture::setup::BenchSection;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};

/// Upper bound of `limits.trash_days`.
const LONGEST_IN_TRASH: u64 = 36_500;

/// Upper bound of `calibration.max_age_days`.
pub(crate) const LONGEST_AGE: u32 = 36_500;

/// Configuration of the service.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Version of the format.
    pub version: Version<1>,
    /// Address to listen on. Addresses other than loopback need a token.
    pub listen: SocketAddr,
    /// Folder of sessions, results, catalogue and job queue.
    pub data: PathBuf,
    /// Further names by which browsers reach the service. Behind a proxy that changes the port, give the whole address
    /// of the page (`https://NAME:PORT`).
    pub hosts: Vec<String>,
    /// Access tokens; `nacre token` makes them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub tokens: Vec<Token>,
    /// Bench of the service.
    pub bench: BenchSection,
    /// Use of stored calibrations.
    pub calibration: CalibrationSection,
    /// Limits of requests and storage.
    pub limits: LimitsSection,
}

/// An access token; only its hash is stored.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Token {
    /// Name of its owner.
    pub name: String,
    /// Role of the token.
    pub role: Role,
    /// SHA-256 of the token in hexadecimal.
    pub sha256: String,
}

/// Role of a token; each includes the ones before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// View sessions, results and devices.
    View,
    /// Move devices, run sessions and reconstructions.
    Operate,
    /// Delete, rename and restore.
    Administer,
}

/// Use of stored calibrations by sessions.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CalibrationSection {
    /// Maximum age in days of calibrations that sessions use, 1 to 36500; sessions warn of older ones.
    #[schemars(range(min = 1, max = 36_500))]
    pub max_age_days: u32,
}

impl Default for CalibrationSection {
    fn default() -> Self {
        Self { max_age_days: MAX_AGE_DAYS }
    }
}

/// Limits of requests and storage.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct LimitsSection {
    /// Largest request body in KiB, except uploads.
    pub body_kib: usize,
    /// Largest upload in MiB, the sum of its files.
    pub upload_mib: u64,
    /// Days after which an upload that no reconstruction uses is deleted.
    pub upload_days: u64,
    /// Days that deleted sessions, uploads and results stay in the trash, 0 to 36500; 0 deletes at once. While less
    /// than 1 GiB or 5 % of the disk is free, whichever is smaller, the trash is emptied and deletions are immediate.
    #[schemars(range(max = 36_500))]
    pub trash_days: u64,
    /// Longest time of a request in seconds, except event streams and uploads.
    pub request_s: u64,
    /// Seconds without progress after which a client is disconnected. Progress is a complete request header or 16 KiB
    /// sent or received. Event streams may stay idle.
    pub client_s: u64,
    /// Most simultaneous requests.
    pub requests: usize,
    /// Most simultaneous event streams.
    pub subscribers: usize,
    /// Memory limit in MiB of the process of a reconstruction or of a camera raw decoder. Default: three quarters of
    /// the memory of the machine, or of the control group or process limit if smaller.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub job_memory_mib: Option<u64>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            version: Version,
            listen: SocketAddr::from(([127, 0, 0, 1], 8465)),
            data: data_folder(),
            hosts: vec![],
            tokens: vec![],
            bench: BenchSection::default(),
            calibration: CalibrationSection::default(),
            limits: LimitsSection::default(),
        }
    }
}

impl Default for LimitsSection {
    fn default() -> Self {
        Self {
            body_kib: 1024,
            upload_mib: 4096,
            upload_days: 30,
            trash_days: 7,
            request_s: 60,
            client_s: 20,
            requests: 64,
            subscribers: 256,
            job_memory_mib: None,
        }
    }
}

fn data_folder() -> PathBuf {
    let set = |name| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let data = set("XDG_DATA_HOME").or_else(|| Some(set("HOME")?.join(".local/share")));
    data.map_or_else(|| "nacre-data".into(), |data| data.join("nacre/service"))
}

/// Default path of the configuration.
pub fn default_path() -> PathBuf {
    "nacre.toml".into()
}

/// Source of the configuration in use.
#[derive(Clone, Debug, Default)]
pub struct Source {
    /// Its file; if the service was started without one, the file in which changes are saved.
    pub file: PathBuf,
    /// Its values from the file and the environment, without options of the command line.
    pub read: Config,
}

impl Config {
    /// Reads a configuration; without a file, the defaults. Environment variables override both.
    ///
    /// # Errors
    /// `Input`, naming the key, for unknown keys and invalid values.
    pub fn read(path: Option<&Path>) -> Result<Self, Error> {
        const LIMIT: u64 = 1 << 20;
        let text =
            path.map(|path| read_text(path, LIMIT, "give a configuration that `nacre init` made")).transpose()?;
        let problem = |problem| Error::input(name(path), problem, "`nacre schema config` lists all keys");
        Self::of(text.as_deref()).map_err(problem)
    }

    /// Configuration of a TOML text; see [`Config::read`].
    ///
    /// # Errors
    /// The key and its problem, for unknown keys and invalid values.
    pub fn of(text: Option<&str>) -> Result<Self, String> {
        let mut figment = Figment::from(Serialized::defaults(Self::default()));
        if let Some(text) = text {
            figment = figment.merge(Serialized::defaults(from_toml::<toml::Table>(text)?));
        }
        let config: Self =
            figment.merge(Env::prefixed("NACRE_SERVE_").split("__")).extract().map_err(|e| explain(&e))?;
        config.check()?;
        Ok(config)
    }

    fn check(&self) -> Result<(), String> {
        let l = &self.limits;
        for (key, value) in [
            ("body_kib", l.body_kib as u64),
            ("upload_mib", l.upload_mib),
            ("upload_days", l.upload_days),
            ("request_s", l.request_s),
            ("client_s", l.client_s),
            ("requests", l.requests as u64),
            ("subscribers", l.subscribers as u64),
            ("job_memory_mib", l.job_memory_mib.unwrap_or(1)),
        ] {
            if !(1..=1 << 30).contains(&value) {
                return Err(format!("limits.{key} is {value}; give a number from 1 to {}", 1 << 30));
            }
        }
        if l.trash_days > LONGEST_IN_TRASH {
            return Err(format!("limits.trash_days is {}; give 0 to {LONGEST_IN_TRASH}", l.trash_days));
        }
        let days = self.calibration.max_age_days;
        if !(1..=LONGEST_AGE).contains(&days) {
            return Err(format!("calibration.max_age_days is {days}; give 1 to {LONGEST_AGE}"));
        }
        if let Some(bad) = self.hosts.iter().find(|h| h.contains('/') && Address::of_origin(h).is_none()) {
            return Err(format!("hosts names {bad:?}; give a name, or an address such as https://bench.lab:8443"));
        }
        if let Some(bad) =
            self.tokens.iter().find(|t| t.sha256.len() != 64 || !t.sha256.bytes().all(|b| b.is_ascii_hexdigit()))
        {
            return Err(format!("the sha256 of the token {:?} is no SHA-256; `nacre token` makes one", bad.name));
        }
        self.bench.check()
    }

    /// Checks that an address which other machines reach has a token.
    ///
    /// # Errors
    /// `Input` if the address is not loopback and there is no token.
    pub fn check_access(&self) -> Result<(), Error> {
        if self.listen.ip().is_loopback() || !self.tokens.is_empty() {
            return Ok(());
        }
        let problem = format!("is {}, which others can reach, but there is no token", self.listen);
        Err(Error::input("listen", problem, "`nacre token` makes one, or listen on 127.0.0.1"))
    }
}

fn name(path: Option<&Path>) -> String {
    path.map_or_else(|| "environment".into(), |p| p.display().to_string())
}

/// Problem that names the key, and the known key that resembles it.
fn explain(error: &figment::Error) -> String {
    let key = error.path.join(".");
    match &error.kind {
        Kind::UnknownField(found, known) => {
            let near = known.iter().map(|k| (strsim::jaro_winkler(k, found), *k)).max_by(|a, b| a.0.total_cmp(&b.0));
            let meant = near
                .filter(|n| n.0 > 0.7)
                .map_or_else(|| format!("there are {}", known.join(", ")), |n| format!("did you mean {}?", n.1));
            let section = key.strip_suffix(found.as_str()).unwrap_or(&key).trim_end_matches('.');
            let place = if section.is_empty() { String::new() } else { format!(" in {section}") };
            format!("unknown key {found}{place}; {meant}")
        }
        kind if key.is_empty() => kind.to_string(),
        kind => format!("{key}: {kind}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Config, String> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        Config::read(Some(file.path())).map_err(|e| e.to_string())
    }

    #[test]
    fn wrong_keys_are_refused_with_a_suggestion() {
        for (text, words) in [
            ("lisen = \"127.0.0.1:1\"", &["lisen", "did you mean listen"][..]),
            ("limits = { body_kb = 1 }", &["body_kb", "limits", "did you mean body_kib"]),
            ("listen = \"here\"", &["listen"]),
            ("limits = { requests = 0 }", &["limits.requests"]),
            ("hosts = [\"https://bench.lab/nacre\"]", &["hosts", "https://bench.lab/nacre"]),
            ("tokens = [{ name = \"a\", role = \"view\", sha256 = \"secret\" }]", &["\"a\"", "SHA-256"]),
            ("tokens = [{ name = \"a\", role = \"king\", sha256 = \"\" }]", &["role", "king"]),
            ("listen = [", &["nacre", "config"]),
        ] {
            let error = read(text).unwrap_err();
            words.iter().for_each(|w| assert!(error.contains(w), "no {w} in {error}"));
            assert!(!error.contains("secret"), "{error}");
        }
        let open = read("listen = \"0.0.0.0:8465\"").unwrap().check_access().unwrap_err().to_string();
        assert!(open.contains("no token") && open.contains("nacre token"), "{open}");
        let config = read("listen = \"127.0.0.1:9\"\nlimits = { requests = 3 }").unwrap();
        assert_eq!((config.listen.port(), config.limits.requests, config.limits.body_kib), (9, 3, 1024));
    }
}
