//! Jobs: the operations of the registry on sessions and uploads of this service.

use super::problem::{Answer, Problem};
use super::used_results::{Staged, resolved};
use super::work::result_folder;
use nacre_base::Error;
use nacre_base::estimate::Work;
use nacre_base::fields::Fields;
use nacre_base::operation::{Input, Ready};
use nacre_base::progress::Progress;
use nacre_frames::FILE_NAME;
use nacre_store::jobs::Spec;
use serde_json::Value;
use std::path::{Component, Path, PathBuf};

/// Checks a job's input and options, and estimates its time, memory and disk. `data` is the service's data folder.
pub fn check(spec: &Spec, data: &Path) -> Answer<Work> {
    let staged = Staged::of(spec, data)?;
    let input = input_of(spec, data, staged.as_ref());
    if spec.session.is_some() {
        match spec.operation.operation().input() {
            Input::Files | Input::FilesOrNothing => {
                let name = spec.operation.name();
                return Err(Problem::bad(format!("method {name} takes an upload, not a session")));
            }
            Input::Photographs if !input.join(FILE_NAME).exists() => {
                let problem = Problem::not_found("complete set of photographs there");
                return Err(problem.remedy("finish the session first"));
            }
            Input::Photographs | Input::Maps => {}
        }
    }
    if let Some(light) = &spec.light {
        if !spec.operation.is("lut") {
            return Err(Problem::bad("light applies to the operation lut only"));
        }
        if !data.join("uploads").join(&light.upload).is_dir() {
            return Err(Problem::not_found(format!("upload {} with a light", light.upload)));
        }
    }
    Ok(ready(spec, data, staged.as_ref())?.check(&input).map_err(|error| as_sent(error, &input))?)
}

/// Input folder of a job; empty for a calibration without photographs, which continues an earlier one.
fn input_of(spec: &Spec, data: &Path, staged: Option<&Staged>) -> PathBuf {
    if let Some(staged) = staged.filter(|_| !spec.results.is_empty()) {
        return staged.input().to_owned();
    }
    match (&spec.session, &spec.upload) {
        (Some(id), _) if spec.operation.operation().input() == Input::Maps => {
            data.join("sessions").join(id).join("results")
        }
        (Some(id), _) => data.join("sessions").join(id),
        (None, Some(id)) => data.join("uploads").join(id),
        (None, None) => PathBuf::new(),
    }
}

/// The operation with its options, in which names of uploaded files are replaced by their paths.
fn ready(spec: &Spec, data: &Path, staged: Option<&Staged>) -> Result<Box<dyn Ready>, Error> {
    let operation = spec.operation.operation();
    let mut options = Value::Object(spec.options.clone());
    let sent = spec.upload.as_ref().map_or_else(|| input_of(spec, data, None), |id| data.join("uploads").join(id));
    found(&operation.fields(), &mut options, &sent, staged)?;
    if let Some(light) = &spec.light {
        options["light"] = light.photograph(&data.join("uploads"));
    }
    operation.with(&options)
}

/// Replaces names of uploaded files, and of results of this service, by their paths. Other files of this machine are
/// refused.
fn found(fields: &Fields, options: &mut Value, input: &Path, staged: Option<&Staged>) -> Result<(), Error> {
    for field in &fields.list {
        let Some(value) = field.file(options) else { continue };
        if resolved(value, staged) {
            continue;
        }
        let Value::String(name) = value else { continue };
        let path = Path::new(name.as_str());
        let plain = matches!(path.components().collect::<Vec<_>>().as_slice(), [Component::Normal(_)]);
        let sent = input.join(path);
        // Without a folder the name would be looked up in the working folder of the service.
        if plain && !input.as_os_str().is_empty() && sent.is_file() {
            *name = sent.display().to_string();
        } else if !field.is_built_in(name) {
            let remedy = "give the name of a file that is in the upload, or result:ID";
            return Err(Error::input(field.path.join("."), format!("{name:?} was not sent"), remedy));
        }
    }
    Ok(())
}

/// Names a file of an error as in the request, without its folder on this machine.
fn as_sent(error: Error, folder: &Path) -> Error {
    match error {
        Error::Input { subject, problem, remedy } if !folder.as_os_str().is_empty() => {
            let name = Path::new(&subject).strip_prefix(folder).map(|file| file.display().to_string());
            Error::Input { subject: name.ok().filter(|n| !n.is_empty()).unwrap_or(subject), problem, remedy }
        }
        other => other,
    }
}

/// Runs a job of the service with this data folder.
///
/// # Errors
/// Those of the operation.
pub fn perform(data: &Path, spec: &Spec, progress: &dyn Progress) -> Result<(), Error> {
    let staged = Staged::of(spec, data)?;
    let input = input_of(spec, data, staged.as_ref());
    let done = ready(spec, data, staged.as_ref())?.perform(&input, &result_folder(data, &spec.id), true, progress);
    done.map(drop).map_err(|error| as_sent(error, &input))
}
