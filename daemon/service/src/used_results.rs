//! Results and sessions of this service as input of an operation: as its input (`results`), or named by an option
//! (`result:ID`, or `session:ID` for the photographs of a session).

use super::App;
use super::problem::{Answer, Problem};
use super::work::result_folder;
use nacre_base::Error;
use nacre_base::operation::Input;
use nacre_capture::plan::Method;
use nacre_capture::session::SESSION_FILE;
use nacre_store::jobs::{Spec, UsedResult};
use serde_json::Value;
use std::collections::HashSet;
use std::os::unix::fs::symlink;
use std::path::{Component, Path, PathBuf};
use tempfile::TempDir;

/// Prefix of an option that names a result instead of an uploaded file.
const PREFIX: &str = "result:";

/// Prefix of an option that names a session instead of uploaded photographs.
const SESSION_PREFIX: &str = "session:";

/// Most results of one operation.
const MOST: usize = 1000;

/// Longest name of a folder in characters.
const LONGEST: usize = 60;

/// Refuses an order with invalid results.
///
/// # Errors
/// `bad-request`.
pub fn check(method: Method, results: &[String], [session, upload]: [Option<&String>; 2]) -> Answer<()> {
    if method.operation().input() != Input::Maps {
        return Err(
            Problem::bad(format!("{} does not take results", method.name())).remedy("give a session or an upload")
        );
    }
    if session.is_some() || results.len() > MOST {
        return Err(Problem::bad(format!("give either a session or at most {MOST} results")));
    }
    results.iter().chain(upload).try_for_each(|id| super::check_id(id).map(drop))
}

impl App {
    /// Looks up names and sessions of the results that an order uses.
    ///
    /// # Errors
    /// `not-found` for a result that does not exist.
    pub async fn look_up_results(&self, spec: &mut Spec, results: &[String]) -> Answer<()> {
        for id in results {
            spec.results.push(self.used_result(id).await?);
        }
        let ids: Vec<String> = spec.options.values().filter_map(|v| Some(named(v.as_str()?)?.0.to_owned())).collect();
        for id in ids {
            spec.named.push(self.used_result(&id).await?);
        }
        let of_session = |v: &Value| v.as_str()?.strip_prefix(SESSION_PREFIX).map(str::to_owned);
        for id in spec.options.values().filter_map(of_session).collect::<Vec<_>>() {
            if !self.session_folder(&id)?.join(SESSION_FILE).exists() {
                return Err(Problem::not_found("such session").remedy("GET /api/v1/sessions lists them"));
            }
            let name = format!("{SESSION_PREFIX}{id}");
            spec.named.push(UsedResult { id: name.clone(), name, session: Some(id) });
        }
        Ok(())
    }

    async fn used_result(&self, id: &str) -> Answer<UsedResult> {
        let name = self.name_of_result(id).await?;
        let session = if self.session_folder(id)?.join(SESSION_FILE).exists() {
            Some(id.to_owned())
        } else {
            let spec = self.job(id).await?.spec;
            spec.session.or_else(|| spec.results.into_iter().find_map(|result| result.session))
        };
        Ok(UsedResult { id: id.to_owned(), name, session })
    }
}

/// Id of a result and the file in it that an option names.
fn named(option: &str) -> Option<(&str, Option<&str>)> {
    let rest = option.strip_prefix(PREFIX)?;
    Some(rest.split_once('/').map_or((rest, None), |(id, file)| (id, Some(file))))
}

/// Folder with links to the files of the results of a job, deleted when dropped. Each result has a folder with its
/// name, in which its session is described too, as operations report both.
pub struct Staged {
    folder: TempDir,
    input: PathBuf,
    named: Vec<(String, PathBuf)>,
}

impl Staged {
    /// The results of a job; `None` for a job without any.
    ///
    /// # Errors
    /// `Input` for a result that no longer exists.
    pub fn of(spec: &Spec, data: &Path) -> Result<Option<Self>, Error> {
        if spec.results.is_empty() && spec.named.is_empty() {
            return Ok(None);
        }
        let failed = |e: std::io::Error| Error::output(&std::env::temp_dir(), e);
        let folder = tempfile::Builder::new().prefix("nacre-results-").tempdir().map_err(failed)?;
        let mut staged = Self { input: folder.path().join("samples"), folder, named: vec![] };
        let mut taken = HashSet::new();
        for result in &spec.results {
            let place = staged.input.join(unique(&result.name, &mut taken));
            link(result, data, &place)?;
            if spec.results.len() == 1 {
                staged.input = place;
            }
        }
        for result in &spec.named {
            if let Some(id) = result.id.strip_prefix(SESSION_PREFIX) {
                staged.named.push((result.id.clone(), data.join("sessions").join(id)));
                continue;
            }
            let place = staged.folder.path().join(&result.id).join(unique(&result.name, &mut HashSet::new()));
            link(result, data, &place)?;
            staged.named.push((result.id.clone(), place));
        }
        Ok(Some(staged))
    }

    /// Input of the operation: the folder of its only result, or that of all.
    pub fn input(&self) -> &Path {
        &self.input
    }

    /// Path of a session, of a result, or of a file in it, that an option names; `None` for other options and missing
    /// files.
    pub fn path(&self, option: &str) -> Option<PathBuf> {
        if option.starts_with(SESSION_PREFIX) {
            return self.named.iter().find(|(known, _)| known == option).map(|(_, place)| place.clone());
        }
        let (id, file) = named(option)?;
        let (_, place) = self.named.iter().find(|(known, _)| known == id)?;
        let Some(file) = file else { return Some(place.clone()) };
        let plain = matches!(Path::new(file).components().collect::<Vec<_>>().as_slice(), [Component::Normal(_)]);
        Some(place.join(file)).filter(|path| plain && path.is_file())
    }
}

/// Links the files of a result, and the description of its session, into a new folder.
fn link(result: &UsedResult, data: &Path, place: &Path) -> Result<(), Error> {
    // A link from another folder does not find a relative path.
    let data = &std::path::absolute(data).map_err(|e| Error::output(data, e))?;
    let session = |id: &str| data.join("sessions").join(id);
    let own = session(&result.id);
    let folder = if own.join(SESSION_FILE).exists() { own.join("results") } else { result_folder(data, &result.id) };
    let gone = |_| Error::input(&result.name, "no longer exists", "choose another result");
    let failed = |e: std::io::Error| Error::output(place, e);
    std::fs::create_dir_all(place).map_err(failed)?;
    for entry in folder.read_dir().map_err(gone)?.flatten().filter(|e| e.path().is_file()) {
        symlink(entry.path(), place.join(entry.file_name())).map_err(failed)?;
    }
    let described = result.session.as_deref().map(|id| session(id).join(SESSION_FILE)).filter(|file| file.is_file());
    let target = place.join(SESSION_FILE);
    match described {
        Some(file) if !target.exists() => symlink(file, target).map_err(failed),
        _ => Ok(()),
    }
}

/// A name that serves as folder and in links, unlike those taken.
fn unique(name: &str, taken: &mut HashSet<String>) -> String {
    let plain = |c: char| if c.is_alphanumeric() || " ._-,()".contains(c) { c } else { '-' };
    let name: String = name.chars().take(LONGEST).map(plain).collect();
    let name = match name.trim_matches([' ', '.']) {
        "" => "result",
        name => name,
    };
    let numbered = (2..).map(|n| format!("{name} ({n})"));
    let mut candidates = std::iter::once(name.to_owned()).chain(numbered);
    candidates.find(|candidate| taken.insert(candidate.clone())).unwrap_or_default()
}

/// Value of an option that is the path of a file.
pub fn resolved(option: &mut Value, staged: Option<&Staged>) -> bool {
    let path = option.as_str().and_then(|name| staged?.path(name));
    path.inspect(|path| *option = path.display().to_string().into()).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_linked_by_name_with_their_sessions() {
        let data = tempfile::tempdir().unwrap();
        let write = |path: &str| {
            let path = data.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "x").unwrap();
        };
        let files = ["sessions/S/session.json", "sessions/S/results/a.exr", "reconstructions/R/limits.toml"];
        files.into_iter().for_each(write);
        let used = |id: &str, session: Option<&str>| UsedResult {
            id: id.into(),
            name: "Sheet 1/2?".into(),
            session: session.map(str::to_owned),
        };
        let spec = Spec {
            results: vec![used("S", Some("S")), used("R", None)],
            named: vec![used("R", None), used("session:S", Some("S"))],
            ..Spec::default()
        };
        let staged = Staged::of(&spec, data.path()).unwrap().unwrap();
        let there = |path: &str| staged.input().join(path).is_file();
        assert!(there("Sheet 1-2-/a.exr") && there("Sheet 1-2-/session.json") && there("Sheet 1-2- (2)/limits.toml"));
        assert!(staged.path("result:R").unwrap().ends_with("Sheet 1-2-"));
        assert!(staged.path("result:R/limits.toml").is_some());
        assert_eq!(staged.path("session:S"), Some(data.path().join("sessions/S")));
        assert_eq!(staged.path("session:R"), None);
        for wrong in ["result:R/../x", "result:R/none.toml", "result:S", "limits.toml"] {
            assert_eq!(staged.path(wrong), None, "{wrong}");
        }
        // A data folder may be relative to the working folder.
        let up: PathBuf = std::env::current_dir().unwrap().components().skip(1).map(|_| "..").collect();
        let relative = up.join(data.path().strip_prefix("/").unwrap());
        let staged = Staged::of(&spec, &relative).unwrap().unwrap();
        assert!(staged.input().join("Sheet 1-2-/a.exr").is_file());
        let gone = Spec { results: vec![used("Q", None)], ..Spec::default() };
        assert!(Staged::of(&gone, data.path()).err().unwrap().to_string().contains("no longer exists"));
    }

    #[test]
    fn ids_are_checked_before_they_become_paths() {
        let method = |name: &str| Method::of(name).unwrap();
        let id = "01JQ0000000000000000000001".to_owned();
        let checked = |name: &str, result: &str, upload: &str| {
            check(method(name), &[result.to_owned()], [None, Some(&upload.to_owned())]).is_ok()
        };
        assert!(checked("inspect", &id, &id));
        assert!(!checked("inspect", "../x", &id) && !checked("inspect", &id, "../x") && !checked("hdr", &id, &id));
    }
}
