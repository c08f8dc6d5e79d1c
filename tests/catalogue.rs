//! Catalogue of session folders: rebuild, search, damage, concurrent use.

#![allow(clippy::unwrap_used)]

use nacre_tests::{Run, binary, listing, nacre};
use serde_json::Value;
use std::fs;
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// A folder with captured sessions and a catalogue.
struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    /// Captures `sessions/NAME` for each name; sample and operator are fixed.
    fn with(names: &[&str]) -> Self {
        let place = Self { folder: tempfile::tempdir().unwrap() };
        fs::create_dir(place.path("sessions")).unwrap();
        fs::write(place.path("bench.toml"), "camera = { width = 16, height = 12 }").unwrap();
        for name in names {
            let plan = format!(
                "kind = \"polarization\"\nname = \"Look at {name}\"\nsample = \"100% Folie_Ä\"\noperator = \"Anna\"
                 camera = {{ exposure_ms = 10 }}\nanalyser = {{ angles_deg = [0, 60, 120] }}"
            );
            fs::write(place.path("plan.toml"), plan).unwrap();
            let (plan, bench) = (place.text("plan.toml"), place.text("bench.toml"));
            let out = place.text(&format!("sessions/{name}"));
            nacre(["capture", &plan, "--sim", "--bench", &bench, "--out", &out]).expect(0);
        }
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.path(name).to_string_lossy().into_owned()
    }

    /// Arguments of a catalogue command on this place's catalogue.
    fn args(&self, args: &[&str]) -> Vec<String> {
        let database = self.text("data/catalogue.db");
        ["--json", "catalogue", "--catalogue", &database].iter().chain(args).map(|s| (*s).to_owned()).collect()
    }

    fn run(&self, args: &[&str]) -> Run {
        nacre(self.args(args))
    }

    fn rebuild(&self) -> Value {
        self.run(&["rebuild", &self.text("sessions")]).expect(0).json()
    }

    fn list(&self, args: &[&str]) -> Vec<Value> {
        let page = self.run(&[&["list"], args].concat()).expect(0).json();
        page["sessions"].as_array().unwrap().clone()
    }

    /// Last components of the listed folders, in alphabetical order.
    fn names(&self, args: &[&str]) -> Vec<String> {
        let folder = |row: &Value| PathBuf::from(row["folder"].as_str().unwrap());
        let name = |row| folder(row).file_name().unwrap().to_string_lossy().into_owned();
        let mut names: Vec<String> = self.list(args).iter().map(name).collect();
        names.sort();
        names
    }
}

#[test]
fn sessions_are_found_listed_and_searched() {
    let place = Place::with(&["tile", "disc"]);
    // A stopped and a killed capture.
    let journal = fs::read_to_string(place.path("sessions/disc/journal")).unwrap();
    let lines: Vec<&str> = journal.split_inclusive('\n').collect();
    fs::write(place.path("sessions/disc/journal"), lines[..lines.len() - 3].concat()).unwrap();
    assert_eq!(place.rebuild()["sessions"], 2);

    let rows = place.list(&["tile"]);
    let row = &rows[0];
    assert_eq!(
        (rows.len(), row["name"].as_str(), row["kind"].as_str()),
        (1, Some("Look at tile"), Some("polarization"))
    );
    assert_eq!((row["frames_planned"].as_u64(), row["frames_committed"].as_u64()), (Some(3), Some(3)));
    assert_eq!(row["state"], "finished");
    let session = place.path("sessions/tile");
    let files = |folder: &str| {
        listing(&session.join(folder)).into_iter().map(|f| session.join(folder).join(f)).collect::<Vec<_>>()
    };
    let sizes =
        files("").into_iter().chain(files("frames")).filter(|f| f.is_file()).map(|f| f.metadata().unwrap().len());
    assert_eq!(row["bytes"].as_u64().unwrap(), sizes.sum::<u64>());

    assert_eq!(place.names(&["--state", "unfinished"]), ["disc"]);
    assert_eq!(place.list(&["disc"])[0]["frames_committed"], 2);
    assert_eq!(place.names(&["--kind", "polarization"]), ["disc", "tile"]);
    assert!(place.run(&["list", "--kind", "nonsense"]).expect(2).stderr().contains("polarization"));
    // Words in any field and any case; wildcards and quotes are ordinary characters.
    for (text, found) in [
        (&["anna", "LOOK"][..], 2),
        (&["FOLIE_ä"], 2),
        (&["100%"], 2),
        (&["1%0"], 0),
        (&["_ook"], 0),
        (&["anna", "disc", "tile"], 0),
        (&["' OR 1=1 --", "\\"], 0),
    ] {
        assert_eq!(place.list(text).len(), if found == 0 { 0 } else { found }, "{text:?}");
    }

    let args = ["catalogue", "list", "--catalogue", &place.text("data/catalogue.db")];
    let table = nacre(args).expect(0).stdout();
    let at = |word: &str| table.lines().map(|l| l.find(word)).collect::<Vec<_>>();
    assert_eq!(table.lines().count(), 3, "{table}");
    assert_eq!(at("Look")[1], at("Look")[2], "{table}");
    assert!(table.contains("3/3") && table.contains("2/3") && table.contains('Z'), "{table}");
}

#[test]
fn a_rebuild_follows_the_folders_and_needs_no_old_catalogue() {
    let place = Place::with(&["one", "two", "three"]);
    // At the maximum depth, too deep, and behind a link.
    let (deep, deeper) = (place.path("sessions/1/2/3/4/5/6/7"), place.path("sessions/a/2/3/4/5/6/7/8"));
    for folder in [&deep, &deeper] {
        fs::create_dir_all(folder).unwrap();
    }
    fs::rename(place.path("sessions/three"), deep.join("three")).unwrap();
    fs::rename(place.path("sessions/two"), place.path("two")).unwrap();
    std::os::unix::fs::symlink(place.path("two"), place.path("sessions/link")).unwrap();
    place.rebuild();
    assert_eq!(place.names(&[]), ["one", "three"]);
    fs::rename(deep.join("three"), deeper.join("three")).unwrap();
    fs::rename(place.path("two"), place.path("sessions/two")).unwrap();
    place.rebuild();
    assert_eq!(place.names(&[]), ["one", "two"]);

    let before = place.list(&[]);
    fs::remove_dir_all(place.path("data")).unwrap();
    assert_eq!(place.list(&[]).len(), 0);
    place.rebuild();
    assert_eq!(place.list(&[]), before);

    fs::remove_dir_all(place.path("sessions/one")).unwrap();
    place.rebuild();
    assert_eq!(place.names(&[]), ["two"]);

    // A mistyped folder does not empty the catalogue.
    let run = place.run(&["rebuild", &place.text("session")]).expect(2);
    assert!(run.stderr().contains("cannot be searched"), "{}", run.stderr());
    assert_eq!(place.names(&[]), ["two"]);
}

#[test]
fn a_damaged_session_is_a_warning_and_the_others_are_listed() {
    let place = Place::with(&["good", "bad", "torn"]);
    let path = place.path("sessions/bad/session.json");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, &text[..text.len() / 2]).unwrap();
    let journal = place.path("sessions/torn/journal");
    let mut bytes = fs::read(&journal).unwrap();
    bytes[60] ^= 1;
    fs::write(&journal, bytes).unwrap();
    let rebuilt = place.run(&["rebuild", &place.text("sessions")]).expect(0);
    for file in ["bad/session.json", "torn: journal"] {
        assert!(rebuilt.stderr().contains(file), "{}", rebuilt.stderr());
    }
    assert_eq!(rebuilt.json()["warnings"].as_array().unwrap().len(), 2);
    assert_eq!(place.names(&[]), ["good"]);
    let run = place.run(&["add", &place.text("sessions/bad")]).expect(2);
    assert!(run.stderr().contains("session.json"), "{}", run.stderr());
}

#[test]
fn files_that_are_no_catalogue_of_this_version_are_refused_and_untouched() {
    let place = Place::with(&["s"]);
    place.rebuild();
    let database = place.path("data/catalogue.db");
    assert_eq!(listing(&place.path("data")), ["catalogue.db"], "everything is in one file once a command has ended");
    let good = fs::read(&database).unwrap();
    // In the header of an SQLite file: user version, application id, and format.
    let patched = |at: usize, bytes: &[u8]| {
        let mut all = good.clone();
        all[at..at + bytes.len()].copy_from_slice(bytes);
        all
    };
    for (bytes, word) in [
        (patched(60, &[0, 0, 0, 9]), "version 9"),
        (patched(68, &[1, 2, 3, 4]), "another program"),
        (patched(0, b"no"), "no intact catalogue"),
        (b"garbage".to_vec(), "no intact catalogue"),
        (b"garbage\n".repeat(4096), "no intact catalogue"),
        (good[..good.len() / 2].to_vec(), "no intact catalogue"),
    ] {
        fs::write(&database, &bytes).unwrap();
        for args in [&["list"][..], &["add", &place.text("sessions/s")], &["rebuild", &place.text("sessions")]] {
            let stderr = place.run(args).expect(2).stderr();
            assert!(stderr.contains(word) && stderr.contains("catalogue.db"), "{word}: {stderr}");
            assert!(stderr.contains("delete it and run `nacre catalogue rebuild"), "{stderr}");
        }
        assert!(fs::read(&database).unwrap() == bytes, "{word}: changed");
        fs::remove_dir_all(place.path("data")).unwrap();
        place.rebuild();
        assert_eq!(place.names(&[]), ["s"]);
    }
}

/// Several processes use the catalogue at once, starting with the creation of the file; one of them also rebuilds it.
#[test]
fn processes_that_use_the_catalogue_at_once_all_succeed() {
    let names = ["a", "b", "c"];
    let place = Place::with(&names);
    for _ in 0..5 {
        let _ = fs::remove_dir_all(place.path("data"));
        let mut commands: Vec<Vec<String>> =
            names.iter().cycle().take(6).map(|n| place.args(&["add", &place.text(&format!("sessions/{n}"))])).collect();
        commands.push(place.args(&["rebuild", &place.text("sessions")]));
        commands.push(place.args(&["list"]));
        let start = |args| Command::new(binary()).args(args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
        let children: Vec<_> = commands.into_iter().map(|args| start(args).unwrap()).collect();
        for child in children {
            let output = child.wait_with_output().unwrap();
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        }
        assert_eq!(place.names(&[]), names);
    }
}

#[test]
fn adding_again_brings_a_session_up_to_date() {
    let place = Place::with(&["s"]);
    let session = place.text("sessions/s");
    let journal = fs::read(place.path("sessions/s/journal")).unwrap();
    fs::write(place.path("sessions/s/journal"), "").unwrap();
    assert_eq!(place.run(&["add", &session]).expect(0).json()["state"], "unfinished");
    fs::write(place.path("sessions/s/journal"), journal).unwrap();
    // By another name of the same folder, at the location given by the environment.
    let again = format!("{session}/../s/");
    let run = Command::new(binary())
        .args(["catalogue", "add", &again])
        .env("NACRE_CATALOGUE", place.text("data/catalogue.db"))
        .output();
    Run(run.unwrap()).expect(0);
    let rows = place.list(&[]);
    assert_eq!((rows.len(), rows[0]["state"].as_str()), (1, Some("finished")));
}

#[test]
fn paging_returns_every_session_once_whatever_is_added_meanwhile() {
    let place = Place::with(&["s0"]);
    // Copies share times in groups, so that the order within a second matters.
    for k in 1..11 {
        let copy = place.path(&format!("sessions/s{k}"));
        fs::create_dir(&copy).unwrap();
        for file in ["session.json", "journal"] {
            fs::copy(place.path("sessions/s0").join(file), copy.join(file)).unwrap();
        }
        let time = std::time::UNIX_EPOCH + std::time::Duration::from_secs(1_700_000_000 + k / 4);
        fs::File::options().append(true).open(copy.join("session.json")).unwrap().set_modified(time).unwrap();
    }
    place.rebuild();
    let whole = place.list(&[]);
    let times: Vec<i64> = whole.iter().map(|row| row["created"].as_i64().unwrap()).collect();
    assert!(whole.len() == 11 && times.is_sorted_by(|a, b| a >= b), "{times:?}");
    for limit in ["1", "3", "11"] {
        let (mut seen, mut after) = (vec![], None::<String>);
        loop {
            let from: Vec<&str> = after.iter().flat_map(|next| ["--after", next]).collect();
            let page = place.run(&[&["list", "--limit", limit], &from[..]].concat()).expect(0).json();
            seen.extend(page["sessions"].as_array().unwrap().clone());
            place.run(&["add", &place.text("sessions/s5")]).expect(0);
            place.rebuild();
            match page["next"].as_str() {
                Some(next) => after = Some(next.to_owned()),
                None => break,
            }
        }
        assert_eq!(seen, whole, "pages of {limit}");
    }
    assert!(place.run(&["list", "--after", "nonsense"]).expect(2).stderr().contains("next"));
}
