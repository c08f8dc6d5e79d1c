//! `nacre calibrations`, and `nacre calibrate keep`.

use crate::console::Console;
use clap::Subcommand;
use nacre_base::calendar::iso;
use nacre_base::{Error, json};
use nacre_capture::Failure;
use nacre_capture::calibrations::{Calibrations, Found, Origin, Record, Stored};
use nacre_capture::ids::new_id;
use nacre_capture::plan::CalibrationKind;
use nacre_capture::session::{RESULTS, SESSION_FILE, SessionFile};
use nacre_service::config::{Config, default_path};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Folder of stored calibrations.
#[derive(clap::Args)]
pub struct StoreArgs {
    /// Data folder of the service (default: that of nacre.toml, else that of `nacre serve`).
    #[arg(long, global = true, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Folder of the calibrations themselves (default: calibrations in the data folder).
    #[arg(long, global = true, value_name = "DIR", conflicts_with = "data")]
    calibrations: Option<PathBuf>,
}

impl StoreArgs {
    fn open(&self) -> Result<Calibrations, Failure> {
        if let Some(folder) = &self.calibrations {
            return Ok(Calibrations::new(folder));
        }
        let configured = || Config::read(Some(default_path()).filter(|path| path.exists()).as_deref());
        let data = self.data.clone().map_or_else(|| configured().map(|config| config.data), Ok)?;
        Ok(Calibrations::of_data(&data))
    }
}

/// Arguments of `nacre calibrations`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre calibrations list --kind camera
  nacre calibrations show 01ARZ3NDEKTSV4RRFFQ69G5FAV
  nacre calibrations remove 01ARZ3NDEKTSV4RRFFQ69G5FAV

Sessions use the newest calibration of each kind that was taken with their devices. `nacre calibrate keep`
stores one.")]
pub struct Args {
    #[command(flatten)]
    store: StoreArgs,
    #[command(subcommand)]
    command: CalibrationsCommand,
}

/// Commands on stored calibrations.
#[derive(Subcommand)]
enum CalibrationsCommand {
    /// List calibrations, the newest photographs first.
    List(ListArgs),
    /// Print the description and the values of a calibration.
    Show(IdArgs),
    /// Delete a calibration. Sessions that used it keep their copy.
    Remove(IdArgs),
}

#[derive(clap::Args)]
#[command(after_help = "Example:\n  nacre calibrations list --kind flat --json")]
struct ListArgs {
    /// List only this kind: camera, flat, analyser, retarder or orientation.
    #[arg(long, value_parser = kind)]
    kind: Option<CalibrationKind>,
}

#[derive(clap::Args)]
#[command(after_help = "Example:\n  nacre calibrations show 01ARZ3NDEKTSV4RRFFQ69G5FAV")]
struct IdArgs {
    /// Identifier of the calibration.
    id: String,
}

fn kind(text: &str) -> Result<CalibrationKind, String> {
    CalibrationKind::of(text)
        .ok_or_else(|| format!("give {}", CalibrationKind::ALL.map(CalibrationKind::name).join(", ")))
}

/// Runs a command on stored calibrations.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let calibrations = args.store.open()?;
    match &args.command {
        CalibrationsCommand::List(list) => {
            let mut records: Vec<Record> = vec![];
            for entry in calibrations.entries() {
                match entry {
                    Ok(stored) => records.push(stored.record),
                    Err(error) => console.note(&format!("warning: {error}")),
                }
            }
            records.retain(|record| list.kind.is_none_or(|kind| record.kind == kind));
            console.result(&table(&records), &records);
        }
        CalibrationsCommand::Show(IdArgs { id }) => {
            let Stored { record, calibration, folder } = calibrations.read(id)?;
            let text = format!("{}{}folder  {}", json(&record), json(&calibration), folder.display());
            let value = serde_json::json!({ "record": record, "calibration": calibration, "folder": folder });
            console.result(&text, &value);
        }
        CalibrationsCommand::Remove(IdArgs { id }) => {
            calibrations.remove(id)?;
            console.result(&format!("removed  {id}"), &serde_json::json!({ "removed": id }));
        }
    }
    Ok(())
}

/// Calibrations as a table with aligned columns.
fn table(records: &[Record]) -> String {
    if records.is_empty() {
        return "no calibrations; `nacre calibrate keep RESULT` stores one".into();
    }
    let plain = |text: &str| text.replace(char::is_control, " ");
    let cells = |record: &Record| {
        let taken = iso(i64::try_from(record.taken).unwrap_or(i64::MAX));
        let name = if record.name.is_empty() { "-".into() } else { plain(&record.name) };
        [record.kind.name().into(), taken, name, record.id.clone(), plain(&record.devices.join(", "))]
    };
    let mut lines = vec![["KIND", "TAKEN", "NAME", "ID", "DEVICES"].map(String::from)];
    lines.extend(records.iter().map(cells));
    let width = |column: usize| lines.iter().map(|l| l[column].chars().count()).max().unwrap_or_default();
    let [kind, taken, name, id] = [0, 1, 2, 3].map(width);
    let line = |[a, b, c, d, e]: &[String; 5]| format!("{a:kind$}  {b:taken$}  {c:name$}  {d:id$}  {e}\n");
    lines.iter().map(line).collect()
}

/// Arguments of `nacre calibrate keep`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre calibrate keep session --data ~/bench        results of a session of kind calibration
  nacre calibrate keep camera --session flats --name \"gain 1\"
  nacre calibrate keep camera --device \"Canon EOS 600D 123\"

Sessions of kind calibration keep their results by themselves if they know the folder of calibrations.")]
pub struct Keep {
    /// Results of `nacre calibrate camera`, flat, analyser, retarder or orientation, or a session with such results.
    result: PathBuf,
    #[command(flatten)]
    store: StoreArgs,
    /// Session of the photographs, which states devices and conditions (default: the session that holds the results).
    #[arg(long, value_name = "DIR", conflicts_with = "device")]
    session: Option<PathBuf>,
    /// Identity of the calibrated device, for photographs without a session; camera and panel for a flat field.
    #[arg(long, value_name = "ID")]
    device: Vec<String>,
    /// Name (default: that of the session's plan).
    #[arg(long)]
    name: Option<String>,
    /// Notes (default: those of the session's plan).
    #[arg(long)]
    notes: Option<String>,
}

impl Keep {
    /// Stores a calibration.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let calibrations = self.store.open()?;
        let is_session = |folder: &&Path| folder.join(SESSION_FILE).is_file();
        let whole = Some(self.result.as_path()).filter(is_session);
        let result = whole.map_or_else(|| self.result.clone(), |session| session.join(RESULTS));
        let around = result.parent().filter(|_| result.ends_with(RESULTS)).filter(is_session);
        let found = Found::read(&result)?;
        let mut origin = match self.session.as_deref().or(around.filter(|_| self.device.is_empty())) {
            Some(folder) => {
                let remedy = "give a session that `nacre capture` took";
                let session = SessionFile::read(folder).map_err(|e| Error::file(folder, e, remedy))?;
                Origin::of_session(found.kind, &folder.canonicalize().unwrap_or_else(|_| folder.into()), &session)
            }
            None => Origin { taken: written(&result), devices: self.device.clone(), ..Origin::default() },
        };
        origin.name = self.name.clone().unwrap_or(origin.name);
        origin.notes = self.notes.clone().unwrap_or(origin.notes);
        let record = calibrations.keep(new_id(), &found, origin).map_err(|error| match error {
            Error::Input { subject, problem, .. } if subject == "devices" => {
                Error::input("--device", problem, "give it for each device, or the --session of the photographs")
            }
            other => other,
        })?;
        console.result(&format!("kept  {} {}", record.kind.name(), record.id), &record);
        Ok(())
    }
}

/// Time of a folder's last change in Unix seconds.
fn written(folder: &Path) -> u64 {
    let changed = std::fs::metadata(folder).and_then(|found| found.modified()).ok();
    changed.and_then(|time| time.duration_since(SystemTime::UNIX_EPOCH).ok()).map_or(0, |time| time.as_secs())
}
