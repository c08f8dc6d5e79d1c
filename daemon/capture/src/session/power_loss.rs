//! Simulated power loss and full disks at every disk operation; after power loss, unsynced data are gone.

use super::{Commit, Disk, Entry, RealDisk, Session, SessionFile, Setup, Timing, check};
use nacre_base::Version;
use nacre_frames::{Calibration, FlatCalibration};
use std::cell::{Cell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};

/// Works on a real folder and records all operations.
#[derive(Default)]
struct Recorder(RefCell<Vec<Operation>>);

/// A disk that is full from a given operation on.
struct Full(Cell<usize>);

impl Full {
    fn one_more(&self) -> io::Result<()> {
        match self.0.get().checked_sub(1) {
            Some(left) => {
                self.0.set(left);
                Ok(())
            }
            None => Err(io::ErrorKind::StorageFull.into()),
        }
    }
}

impl Disk for &Full {
    fn create_dir(&self, path: &Path) -> io::Result<()> {
        self.one_more().and_then(|()| RealDisk.create_dir(path))
    }
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        self.one_more().and_then(|()| RealDisk.write(path, bytes))
    }
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.one_more().and_then(|()| RealDisk.rename(from, to))
    }
    fn sync_dir(&self, path: &Path) -> io::Result<()> {
        self.one_more().and_then(|()| RealDisk.sync_dir(path))
    }
    fn append(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        // A full disk may store the beginning of a line.
        self.one_more().inspect_err(|_| _ = RealDisk.append(path, &bytes[..bytes.len() / 2]))?;
        RealDisk.append(path, bytes)
    }
    fn truncate(&self, path: &Path, length: u64) -> io::Result<()> {
        self.one_more().and_then(|()| RealDisk.truncate(path, length))
    }
}

#[derive(Clone)]
enum Operation {
    CreateDir,
    Write(PathBuf, Vec<u8>),
    Rename(PathBuf, PathBuf),
    SyncDir(PathBuf),
    Append(PathBuf, Vec<u8>),
    Truncate(PathBuf, u64),
}

impl Disk for &Recorder {
    fn create_dir(&self, path: &Path) -> io::Result<()> {
        self.0.borrow_mut().push(Operation::CreateDir);
        RealDisk.create_dir(path)
    }
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        self.0.borrow_mut().push(Operation::Write(path.into(), bytes.into()));
        RealDisk.write(path, bytes)
    }
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.0.borrow_mut().push(Operation::Rename(from.into(), to.into()));
        RealDisk.rename(from, to)
    }
    fn sync_dir(&self, path: &Path) -> io::Result<()> {
        self.0.borrow_mut().push(Operation::SyncDir(path.into()));
        RealDisk.sync_dir(path)
    }
    fn append(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        self.0.borrow_mut().push(Operation::Append(path.into(), bytes.into()));
        RealDisk.append(path, bytes)
    }
    fn truncate(&self, path: &Path, length: u64) -> io::Result<()> {
        self.0.borrow_mut().push(Operation::Truncate(path.into(), length));
        RealDisk.truncate(path, length)
    }
}

/// A disk after power loss. Contents are durable once written (all writes sync them). Names are durable only after the
/// sync of their folder; until then, either the old or the new name may exist.
#[derive(Clone, Default)]
struct Model {
    durable: BTreeMap<PathBuf, Vec<u8>>,
    pending: BTreeMap<PathBuf, Vec<u8>>,
    removed: BTreeSet<PathBuf>,
}

impl Model {
    fn now(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let mut all = self.durable.clone();
        all.retain(|path, _| !self.removed.contains(path));
        all.extend(self.pending.clone());
        all
    }

    fn apply(&mut self, operation: &Operation) {
        match operation {
            Operation::CreateDir => {}
            Operation::Write(path, bytes) => {
                self.pending.insert(path.clone(), bytes.clone());
            }
            Operation::Rename(from, to) => {
                if let Some(bytes) = self.now().remove(from) {
                    self.pending.remove(from);
                    self.removed.insert(from.clone());
                    self.pending.insert(to.clone(), bytes);
                }
            }
            Operation::SyncDir(folder) => {
                let here = |path: &PathBuf| path.parent() == Some(folder);
                self.durable.retain(|path, _| !(here(path) && self.removed.contains(path)));
                self.removed.retain(|path| !here(path));
                let (synced, rest) = std::mem::take(&mut self.pending).into_iter().partition(|(path, _)| here(path));
                self.durable.extend::<BTreeMap<_, _>>(synced);
                self.pending = rest;
            }
            Operation::Append(path, bytes) => {
                let mut content = self.now().remove(path).unwrap_or_default();
                content.extend(bytes);
                // Syncing a file whose name is durable makes its contents durable.
                let place = if self.durable.contains_key(path) { &mut self.durable } else { &mut self.pending };
                place.insert(path.clone(), content);
            }
            Operation::Truncate(path, length) => {
                for place in [&mut self.durable, &mut self.pending] {
                    if let Some(content) = place.get_mut(path) {
                        content.truncate(*length as usize);
                    }
                }
            }
        }
    }
}

fn description() -> SessionFile {
    let plan = "kind = \"polarization\"\nanalyser = { angles_deg = [0, 60, 120] }";
    let flat = FlatCalibration { source: None, file: super::FLAT_FILE.into(), sigma: 0.0 };
    SessionFile {
        version: Version,
        software: "test".into(),
        created: 0,
        setup: Setup::default(),
        plan: toml::from_str(plan).unwrap(),
        devices: vec![],
        exposure_s: 0.01,
        bench: None,
        section: None,
        mounting: None,
        calibration: Some(Calibration { flat: Some(flat), ..Calibration::default() }),
        warnings: vec![],
    }
}

/// Flat field of the session.
const FLAT: &[u8] = b"flat field";

fn frame(file: &str) -> Vec<u8> {
    format!("frame {file}").repeat(5).into_bytes()
}

/// Captures missing frames, as the engine does.
fn complete<D: Disk>(session: &mut Session<D>) -> io::Result<()> {
    for step in description().plan.steps() {
        if !session.has(&step.file) {
            session.store(&step.file, &frame(&step.file), Commit::default())?;
        }
    }
    session.finish("{}", Timing::default())
}

#[test]
fn a_disk_that_fills_up_at_any_operation_is_an_error_that_can_be_resumed() {
    let home = tempfile::tempdir().unwrap();
    let mut failed = 0;
    for operations in 0.. {
        let (folder, disk) = (home.path().join(format!("s{operations}")), Full(Cell::new(operations)));
        let outcome = Session::create(&disk, &folder, &description(), Some(FLAT)).and_then(|mut session| {
            let result = complete(&mut session);
            // As the engine does, whether or not the disk accepts it.
            result.inspect_err(|e| _ = session.record(Entry::Stopped { reason: e.to_string(), fault: None }))
        });
        match outcome {
            Ok(()) => break,
            Err(e) => assert_eq!(e.kind(), io::ErrorKind::StorageFull),
        }
        failed += 1;
        if folder.join(super::SESSION_FILE).exists() {
            let mut session = Session::open(RealDisk, &folder).unwrap();
            complete(&mut session).unwrap();
            let after = check(&folder).unwrap();
            assert!(after.finished && after.trouble.is_empty(), "{operations}: {after:?}");
            std::fs::write(folder.join(super::FLAT_FILE), "another").unwrap();
            assert_eq!(check(&folder).unwrap().trouble[0].file, super::FLAT_FILE, "its checksum is recorded");
        } else {
            assert!(super::is_vacant(&folder), "{operations}: a new attempt is possible");
        }
    }
    assert!(failed > 20, "{failed}");
}

#[test]
fn any_prefix_of_the_disk_operations_can_be_resumed_after_power_loss() {
    let home = tempfile::tempdir().unwrap();
    let (folder, recorder) = (home.path().join("s"), Recorder::default());
    complete(&mut Session::create(&recorder, &folder, &description(), Some(FLAT)).unwrap()).unwrap();
    let operations = recorder.0.borrow().clone();
    let is_begun = |files: &BTreeMap<PathBuf, Vec<u8>>| files.contains_key(&folder.join(super::SESSION_FILE));
    let mut model = Model::default();
    let mut tried = 0;
    for operation in &operations {
        model.apply(operation);
        // Two extremes: none or all of the pending data survived; and in addition an incomplete line of the journal.
        for (mut files, tear) in [(model.durable.clone(), 0), (model.now(), 0), (model.durable.clone(), 7)] {
            if !is_begun(&files) {
                continue;
            }
            if let Some(journal) = files.get_mut(&folder.join("journal")).filter(|_| tear > 0) {
                journal.truncate(journal.len().saturating_sub(tear));
            }
            let place = tempfile::tempdir().unwrap();
            let copy = place.path().join("s");
            std::fs::create_dir_all(copy.join("frames")).unwrap();
            for (path, bytes) in files {
                std::fs::write(copy.join(path.strip_prefix(&folder).unwrap()), bytes).unwrap();
            }
            let before = check(&copy).unwrap();
            let expected = |p: &str| p.contains("not taken yet") || p.contains("does not record it");
            assert!(before.trouble.iter().all(|t| expected(&t.problem)), "{before:?}");
            let mut session = Session::open(RealDisk, &copy).unwrap();
            complete(&mut session).unwrap();
            let after = check(&copy).unwrap();
            assert!(after.finished && after.trouble.is_empty(), "{after:?}");
            assert_eq!(std::fs::read(copy.join(super::FLAT_FILE)).unwrap(), FLAT);
            for step in description().plan.steps() {
                assert_eq!(std::fs::read(copy.join(&step.file)).unwrap(), frame(&step.file));
            }
            tried += 1;
        }
    }
    assert!(tried > 40, "{tried}");
}
