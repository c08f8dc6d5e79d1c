//! Files of earlier versions: all are read, and those of later versions are rejected with their number.
//!
//! Each folder of `tests/versions` holds files as written by the program, or by users, when that version was the
//! latest.

#![allow(clippy::unwrap_used)]

use nacre_tests::http::Service;
use nacre_tests::{Place, nacre};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

fn copied(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        let new = to.join(entry.file_name());
        if entry.path().is_dir() {
            copied(&entry.path(), &new);
        } else {
            fs::copy(entry.path(), new).unwrap();
        }
    }
}

/// A copy of each version's files.
fn versions() -> Vec<Place> {
    let all = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("versions");
    let folders = fs::read_dir(all).unwrap().map(|entry| entry.unwrap().path());
    let place = |folder: PathBuf| {
        let place = Place::new("");
        copied(&folder, &place.path(""));
        place
    };
    folders.map(place).collect()
}

/// Commands that read one file each, by file.
fn readers(place: &Place) -> Vec<(&'static str, Vec<String>)> {
    let line = |file: &'static str, words: &[&str]| {
        let path = |word: &&str| {
            if word.contains('.') || word.starts_with("session") { place.text(word) } else { (*word).into() }
        };
        (file, words.iter().map(path).collect())
    };
    vec![
        line("plan.toml", &["plan", "check", "plan.toml", "--sim"]),
        line("table.toml", &["plan", "estimate", "table.toml", "--sim"]),
        line("bench.toml", &["plan", "check", "plan.toml", "--sim", "--bench", "bench.toml"]),
        line("scene.toml", &["render", "scene.toml", "--samples", "2", "--force", "--out", "picture.exr"]),
        line(
            "geometry.json",
            &["calibrate", "geometry", "geometry.json", "--wavelength", "532", "--force", "--out", "new.json"],
        ),
        line(
            "session/frames.json",
            &["reconstruct", "polarization", "session/frames.json", "--force", "--out", "maps.d"],
        ),
        line("session/session.json", &["capture", "--sim", "--resume", "session"]),
    ]
}

#[test]
fn files_of_every_version_are_read() {
    for place in versions() {
        for (file, args) in readers(&place) {
            let run = nacre(&args);
            assert_eq!(run.code(), 0, "{file}: {}", run.stderr());
        }
        // The session's plan requests results, which were computed on resume.
        let report: Value =
            serde_json::from_slice(&fs::read(place.path("session/results/report.json")).unwrap()).unwrap();
        assert_eq!((&report["model"], &report["version"]), (&"sinusoid".into(), &1.into()));
    }
}

/// Jobs left in the queue by an earlier version are performed as requested.
#[test]
fn jobs_of_every_version_are_done() {
    for place in versions() {
        let service = Service::serve(&place, &["--config", &place.text("nacre.toml")]);
        let all = service.get("/api/v1/reconstructions").expect(200).json();
        let jobs = all["items"].as_array().unwrap();
        assert_eq!(jobs.len(), 3, "{all}");
        for job in jobs {
            let path = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
            let done =
                service.until(&path, |job| ["done", "failed", "set_aside"].contains(&job["state"].as_str().unwrap()));
            assert_eq!(done["state"], "done", "{done}");
            assert_eq!(
                (&done["method"], &done["report"]["model"]),
                (&"polarization".into(), &"sinusoid".into()),
                "{done}"
            );
        }
        let given: Vec<&Value> = jobs.iter().map(|job| &job["options"]).collect();
        assert!(given.iter().any(|options| options["offset_deg"] == 3.0), "{given:?}");
        assert!(given.iter().any(|options| options["relative_period"] == serde_json::json!([0.7, 2.0])), "{given:?}");
    }
}

#[test]
fn files_of_later_versions_are_refused_by_number() {
    for place in versions() {
        for (file, args) in readers(&place) {
            let path = place.path(file);
            let text = fs::read_to_string(&path).unwrap();
            let later = match file.ends_with(".json") {
                true => text.replacen('{', "{\n  \"version\": 99,", 1),
                false => format!("version = 99\n{text}"),
            };
            fs::write(&path, later).unwrap();
            let run = nacre(&args);
            assert!(run.code() == 2 && run.stderr().contains("version 99"), "{file}: {}", run.stderr());
            fs::write(&path, text).unwrap();
        }
    }
}
