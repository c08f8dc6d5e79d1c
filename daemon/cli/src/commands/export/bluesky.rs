//! Sessions as Bluesky documents (`event-model`), with the frames as TIFF sequences beside them.
//!
//! The documents are JSON lines `{"name": …, "doc": …}`, as the `JSONLinesWriter` of Bluesky writes them. Their uids
//! derive from the checksum of `session.json`, so that two exports of a session are the same run.

use super::{Exported, bag, written};
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_capture::plan::{Extra, Role, Step};
use nacre_capture::session::{Commit, Entry, Journal, SessionFile, sha256, unreadable_journal};
use nacre_image::{OutputFolder, Raster, Samples, read};
use serde_json::{Map, Value, json};
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use tiff::encoder::{TiffEncoder, colortype};

/// File with the documents.
const DOCUMENTS: &str = "documents.jsonl";

/// Column of the frames in all streams.
const CAMERA: &str = "camera";

/// Session with its journal.
struct Run<'a> {
    folder: &'a Path,
    session: SessionFile,
    journal: Journal,
    /// Unix time in s of each file's last commit.
    times: HashMap<String, f64>,
    /// Checksum of `session.json`, from which all uids derive.
    checksum: String,
}

/// A frame with its step of the plan.
struct Shot<'a> {
    step: &'a Step,
    commit: &'a Commit,
    time: f64,
}

/// Writes the documents and the frames. `out` is the final output folder, which the documents name.
pub fn write(input: &Path, out: &Path, folder: &OutputFolder, progress: &dyn Progress) -> Result<Exported> {
    let run = Run::read(input)?;
    let steps = run.session.plan.steps_with(&run.journal.chosen());
    let mut exported = Exported { warnings: bag::warnings(input), ..Exported::default() };
    progress.stage("copying frames", steps.len() as u64);
    let mut documents = vec![("start", run.start())];
    let mut events = Map::new();
    for stream in ["primary", "dark", "display_black"] {
        let shots: Vec<Shot> = steps.iter().filter(|s| name(s.role) == stream).filter_map(|s| run.shot(s)).collect();
        if shots.is_empty() {
            continue;
        }
        folder.create_dir(stream)?;
        let mut shape = vec![];
        for (k, shot) in shots.iter().enumerate() {
            progress.check()?;
            let file = format!("{stream}/{k:04}.tif");
            shape = copy(&input.join(&shot.step.file), &folder.path(&file))?;
            written(&mut exported, folder, file)?;
            progress.step();
        }
        events.insert(stream.into(), shots.len().into());
        run.stream(stream, &shots, &shape, out, &mut documents);
    }
    documents.push(("stop", run.stop(events)));
    let mut file = BufWriter::new(File::create(folder.path(DOCUMENTS)).map_err(|e| Error::output(out, e))?);
    for (name, doc) in documents {
        writeln!(file, "{}", json!({"name": name, "doc": doc})).map_err(|e| Error::output(out, e))?;
    }
    file.flush().map_err(|e| Error::output(out, e))?;
    drop(file);
    written(&mut exported, folder, DOCUMENTS.into())?;
    Ok(exported)
}

/// Stream of a frame's role.
fn name(role: Role) -> &'static str {
    match role {
        Role::Series => "primary",
        Role::Extra(Extra::Dark) => "dark",
        Role::Extra(Extra::DisplayBlack) => "display_black",
    }
}

impl<'a> Run<'a> {
    fn read(folder: &'a Path) -> Result<Self> {
        let remedy = "give a folder that `nacre capture` or `nacre sim render` made";
        let unreadable = |e: io::Error| Error::file(folder, format!("is not a session: {e}"), remedy);
        let session = SessionFile::read(folder).map_err(unreadable)?;
        let text = std::fs::read(folder.join(nacre_frames::SESSION_FILE)).map_err(unreadable)?;
        let (journal, _) = Journal::read(&folder.join(Journal::NAME)).map_err(|e| unreadable_journal(folder, &e))?;
        let created = session.created as f64;
        let time = |(time, entry): (Option<f64>, &Entry)| match entry {
            Entry::Committed(commit) => Some((commit.file.clone(), time.unwrap_or(created))),
            _ => None,
        };
        let times = journal.timed().filter_map(time).collect();
        Ok(Self { folder, session, journal, times, checksum: sha256(&text) })
    }

    /// The frame of a step, if it is recorded and there.
    fn shot<'b>(&'b self, step: &'b Step) -> Option<Shot<'b>> {
        let commit = self.journal.commit(&step.file).filter(|_| self.folder.join(&step.file).exists())?;
        Some(Shot { step, commit, time: self.times.get(&step.file).copied()? })
    }

    /// UUID (version 8) of a part of the session.
    fn uid(&self, part: &str) -> String {
        let h = sha256(format!("{} {part}", self.checksum).as_bytes());
        format!("{}-{}-8{}-a{}-{}", &h[..8], &h[8..12], &h[13..16], &h[17..20], &h[20..32])
    }

    fn start(&self) -> Value {
        let SessionFile { plan, software, devices, setup, warnings, .. } = &self.session;
        let begun = self.journal.timed().find_map(|(time, _)| time);
        let mut start = json!({
            "uid": self.uid("start"),
            "time": begun.unwrap_or(self.session.created as f64),
            "plan_name": plan.kind,
            "plan_type": "nacre",
            "detectors": [CAMERA],
            "num_points": plan.steps_with(&self.journal.chosen()).iter().filter(|s| s.role == Role::Series).count(),
            "nacre": {
                "software": software,
                "devices": devices,
                "setup": setup,
                "plan": plan,
                "warnings": warnings,
            },
        });
        let stated =
            [("title", &plan.name), ("sample", &plan.sample), ("operator", &plan.operator), ("notes", &plan.notes)];
        for (key, text) in stated.into_iter().filter(|(_, text)| !text.is_empty()) {
            start[key] = json!(text);
        }
        let turned = |step: &Step| step.role == Role::Series && step.state.analyser_deg.is_some();
        if plan.steps_with(&self.journal.chosen()).iter().any(turned) {
            start["motors"] = json!(["analyser_deg"]);
            start["hints"] = json!({"dimensions": [[["analyser_deg"], "primary"]]});
        }
        start
    }

    /// Documents of one stream: descriptor, events, and the sequence of frames.
    fn stream(&self, stream: &str, shots: &[Shot], shape: &[usize], out: &Path, documents: &mut Documents) {
        let columns = columns(shots);
        let (descriptor, resource) = (self.uid(stream), self.uid(&format!("{stream} {CAMERA}")));
        let mut keys = Map::new();
        for (name, unit, values) in &columns {
            keys.insert((*name).into(), data_key(unit, &values[0]));
        }
        let dims = &["y", "x", "colour"][..shape.len()];
        keys.insert(
            CAMERA.into(),
            json!({
                "source": "frames of the session, values as in their files", "dtype": "array", "dtype_numpy": "<u2",
                "shape": shape, "dims": dims, "external": "STREAM:",
            }),
        );
        let names: Vec<&str> = keys.keys().map(String::as_str).collect();
        let time = shots.first().map(|s| s.time);
        let text = json!({
            "uid": descriptor, "run_start": self.uid("start"), "time": time, "name": stream,
            "object_keys": {"nacre": names}, "data_keys": keys, "configuration": {},
            "hints": {"nacre": {"fields": columns.iter().map(|c| c.0).filter(|c| *c == "analyser_deg").collect::<Vec<_>>()}},
        });
        documents.push(("descriptor", text));
        documents.push((
            "stream_resource",
            json!({
                "uid": resource, "run_start": self.uid("start"), "data_key": CAMERA,
                "mimetype": "multipart/related;type=image/tiff", "uri": uri(&out.join(stream)),
                "parameters": {"template": "{:04d}.tif", "chunk_shape": [1], "join_method": "stack"},
            }),
        ));
        for (k, shot) in shots.iter().enumerate() {
            let row = |value: &dyn Fn(&Vec<Value>) -> Value| -> Map<String, Value> {
                columns.iter().map(|(name, _, values)| ((*name).into(), value(values))).collect()
            };
            documents.push((
                "event",
                json!({
                    "uid": self.uid(&shot.step.file), "descriptor": descriptor, "seq_num": k + 1, "time": shot.time,
                    "data": row(&|values| values[k].clone()), "timestamps": row(&|_| shot.time.into()), "filled": {},
                }),
            ));
        }
        documents.push((
            "stream_datum",
            json!({
                "uid": format!("{resource}/0"), "stream_resource": resource, "descriptor": descriptor,
                "indices": {"start": 0, "stop": shots.len()},
                "seq_nums": {"start": 1, "stop": shots.len() + 1},
            }),
        ));
    }

    fn stop(&self, events: Map<String, Value>) -> Value {
        let ended = self.journal.timed().filter_map(|(time, _)| time).next_back();
        let (status, reason) = match (self.journal.finished(), self.journal.why_stopped()) {
            (true, _) => ("success", String::new()),
            (false, Some(reason)) if self.journal.fault().is_some() => ("fail", reason),
            (false, reason) => ("abort", reason.unwrap_or("the session is not finished".into())),
        };
        json!({
            "uid": self.uid("stop"), "run_start": self.uid("start"), "exit_status": status, "reason": reason,
            "time": ended.unwrap_or(self.session.created as f64), "num_events": events,
        })
    }
}

/// Documents with their names.
type Documents = Vec<(&'static str, Value)>;

/// Values of the events: name, unit, and a value per frame. Columns with missing values are left out, since all events
/// of a stream have the same keys.
fn columns(shots: &[Shot]) -> Vec<(&'static str, &'static str, Vec<Value>)> {
    let number = |value: Option<f64>| value.map_or(Value::Null, Value::from);
    let column = |value: &dyn Fn(&Shot) -> Value| shots.iter().map(value).collect::<Vec<_>>();
    let mut columns = vec![
        ("analyser_deg", "deg", column(&|s| number(s.commit.analyser_deg))),
        ("analyser_planned_deg", "deg", column(&|s| number(s.step.state.analyser_deg))),
        ("exposure_s", "s", column(&|s| number(Some(s.commit.exposure_ns as f64 / 1e9)))),
        ("gain", "", column(&|s| number(Some(s.commit.gain)))),
        ("flash", "", column(&|s| s.step.state.flash.into())),
        ("shutter_closed", "", column(&|s| s.step.state.covered.into())),
        ("display", "", column(&|s| json!(s.step.state.pattern).to_string().into())),
        ("file", "", column(&|s| s.step.file.clone().into())),
        ("sha256", "", column(&|s| s.commit.sha256.clone().into())),
    ];
    columns.retain(|(_, _, values)| !values.iter().any(Value::is_null));
    columns
}

/// Description of a column.
fn data_key(unit: &str, value: &Value) -> Value {
    let dtype = match value {
        Value::Bool(_) => "boolean",
        Value::Number(_) => "number",
        _ => "string",
    };
    let mut key = json!({"source": "plan and journal of the session", "dtype": dtype, "shape": []});
    if !unit.is_empty() {
        key["units"] = unit.into();
    }
    key
}

/// URI of a folder, with a slash at its end.
fn uri(folder: &Path) -> String {
    let path = std::path::absolute(folder).unwrap_or_else(|_| folder.to_path_buf());
    let mut uri = String::from("file://localhost");
    for byte in path.as_os_str().as_encoded_bytes() {
        match byte {
            b'/' | b'-' | b'_' | b'.' | b'~' => uri.push(*byte as char),
            _ if byte.is_ascii_alphanumeric() => uri.push(*byte as char),
            _ => uri += &format!("%{byte:02X}"),
        }
    }
    uri + "/"
}

/// Writes a frame as an uncompressed 16-bit TIFF; returns its shape as an array.
fn copy(from: &Path, to: &Path) -> Result<Vec<usize>> {
    let Raster { width, height, channels, samples } = read(from)?;
    let samples: Vec<u16> = match samples {
        Samples::U16(samples) => samples,
        Samples::U8(samples) => samples.into_iter().map(u16::from).collect(),
        Samples::F32(_) => {
            return Err(Error::file(from, "has values in floating point", "use --format zarr, which keeps them"));
        }
    };
    let write = || {
        let mut encoder = TiffEncoder::new(BufWriter::new(File::create(to)?))?;
        let (width, height) = (width as u32, height as u32);
        match channels {
            1 => encoder.write_image::<colortype::Gray16>(width, height, &samples),
            _ => encoder.write_image::<colortype::RGB16>(width, height, &samples),
        }
    };
    write().map_err(|e: tiff::TiffError| Error::output(to, io::Error::other(e)))?;
    let mut shape = vec![height, width];
    shape.extend((channels > 1).then_some(channels));
    Ok(shape)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_become_uris() {
        assert_eq!(uri(Path::new("/data/my run%é")), "file://localhost/data/my%20run%25%C3%A9/");
    }
}
