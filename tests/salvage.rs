//! Sessions with a damaged journal: `nacre salvage` recovers undamaged lines, reports losses, and destroys nothing.

#![allow(clippy::unwrap_used)]

use nacre_tests::http::Service;
use nacre_tests::{BENCH, Place, binary, data, listing, nacre};
use serde_json::Value;
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::process::Command;

/// 22 lines: begun, session.json sealed, intent and commit of nine frames, frames.json sealed, finished.
const PLAN: &str = r#"
    kind = "polarization"
    camera = { exposure_ms = 8 }
    analyser = { angles_deg = [0, 22.5, 45, 67.5, 90, 112.5, 135, 157.5] }
    extras = ["display_black"]
"#;

type Lines = Vec<Vec<u8>>;

/// Damage to the lines of a journal, and the losses that must be reported.
struct Damage {
    name: &'static str,
    make: fn(&mut Lines),
    /// Numbers of damaged lines in the report.
    damaged: &'static [u64],
    lost: u64,
    /// Frames without a recorded commit.
    unrecorded: &'static [&'static str],
    unverified: &'static [&'static str],
}

const NONE: Damage = Damage { name: "", make: |_| {}, damaged: &[], lost: 0, unrecorded: &[], unverified: &[] };

/// Commits are the odd lines from the fourth; the first one is of the extra frame.
const DAMAGES: [Damage; 13] = [
    Damage { name: "first line", make: |l| l[0][20] ^= 1, damaged: &[1], lost: 1, ..NONE },
    Damage {
        name: "checksum of session.json",
        make: |l| l[1][60] ^= 1,
        damaged: &[2],
        lost: 1,
        unverified: &["session.json"],
        ..NONE
    },
    Damage { name: "an intent", make: |l| l[4][50] ^= 1, damaged: &[5], lost: 1, ..NONE },
    Damage {
        name: "a commit that is not UTF-8",
        make: |l| l[7][200] = 0xff,
        damaged: &[8],
        lost: 1,
        unrecorded: &["frames/0001.png"],
        ..NONE
    },
    Damage { name: "a lost line", make: |l| _ = l.remove(6), lost: 1, ..NONE },
    Damage { name: "a lost commit", make: |l| _ = l.remove(9), lost: 1, unrecorded: &["frames/0002.png"], ..NONE },
    Damage {
        name: "zeros over several lines",
        make: |l| {
            l.drain(5..10);
            l.insert(5, [vec![0; 900], b"\n".to_vec()].concat());
        },
        damaged: &[6],
        lost: 5,
        unrecorded: &["frames/0000.png", "frames/0001.png", "frames/0002.png"],
        ..NONE
    },
    Damage { name: "garbage between lines", make: |l| l.insert(3, b"\xfe\xed\n".to_vec()), damaged: &[4], ..NONE },
    Damage { name: "a line twice", make: |l| l.insert(3, l[2].clone()), ..NONE },
    Damage { name: "a wrong number", make: |l| l[3] = replaced(&l[3], "\"seq\":3", "\"seq\":1"), ..NONE },
    Damage { name: "the last line cut off", make: |l| l[21].truncate(30), damaged: &[22], lost: 1, ..NONE },
    Damage {
        name: "the last two lines",
        make: |l| {
            l[20][70] ^= 1;
            l[21][20] ^= 1;
        },
        damaged: &[21, 22],
        lost: 2,
        unverified: &["frames.json"],
        ..NONE
    },
    Damage {
        name: "a line of 100 MB",
        make: |l| l.insert(4, [vec![b'x'; 100_000_000], b"\n".to_vec()].concat()),
        damaged: &[5],
        ..NONE
    },
];

fn replaced(line: &[u8], from: &str, to: &str) -> Vec<u8> {
    let text = String::from_utf8(line.to_vec()).unwrap();
    assert!(text.contains(from), "{text}");
    text.replace(from, to).into_bytes()
}

fn lines(place: &Place) -> Lines {
    fs::read(place.path("s/journal")).unwrap().split_inclusive(|b| *b == b'\n').map(<[u8]>::to_vec).collect()
}

/// Runs `nacre salvage` with little memory.
fn salvaged(place: &Place, more: &str) -> Value {
    let script = format!("ulimit -d 65536 && exec \"$0\" --json salvage s {more}");
    let run = Command::new("sh").args(["-c", &script]).arg(binary()).current_dir(place.path("")).output().unwrap();
    assert_eq!((run.status.code(), run.status.signal()), (Some(0), None), "{}", String::from_utf8_lossy(&run.stderr));
    serde_json::from_slice(&run.stdout).unwrap()
}

fn strings(values: &Value, of: impl Fn(&Value) -> Value) -> Vec<String> {
    let list = values.as_array().into_iter().flatten();
    list.map(|value| of(value).as_str().unwrap().to_owned()).collect()
}

#[test]
fn whatever_the_damage_the_rest_is_kept() {
    let place = Place::new(PLAN);
    nacre(place.capture("whole")).expect(0);
    let whole = data(&place.path("whole"));
    for damage in &DAMAGES {
        let name = damage.name;
        Command::new("cp").args(["-r", &place.text("whole"), &place.text("s")]).status().unwrap();
        let mut journal = lines(&place);
        assert_eq!(journal.len(), 22);
        (damage.make)(&mut journal);
        let journal = journal.concat();
        fs::write(place.path("s/journal"), &journal).unwrap();
        for args in [vec!["check".into(), place.text("s")], place.resume("s")] {
            // A damaged last line counts as incompletely written.
            if !name.starts_with("the last line") {
                let refused = nacre(args).expect(2).stderr();
                assert!(refused.contains("nacre salvage"), "{name}: {refused}");
            }
        }

        let before = salvaged(&place, "--dry-run");
        assert!(!place.path("s/journal.damaged").exists() && fs::read(place.path("s/journal")).unwrap() == journal);
        let report = salvaged(&place, "");
        assert_eq!(before, report, "{name}");
        assert!(fs::read(place.path("s/journal.damaged")).unwrap() == journal, "{name}: the damaged one is kept");
        let damaged: Vec<u64> =
            report["lines"].as_array().unwrap().iter().map(|l| l["line"].as_u64().unwrap()).collect();
        assert_eq!((damaged.as_slice(), report["lost"].as_u64()), (damage.damaged, Some(damage.lost)), "{name}");
        let condition = &report["condition"];
        assert_eq!(strings(&condition["trouble"], |t| t["file"].clone()), damage.unrecorded, "{name}");
        assert!(strings(&condition["trouble"], |t| t["problem"].clone()).iter().all(|p| p.contains("is there, but")));
        assert_eq!(strings(&condition["unverified"], Value::clone), damage.unverified, "{name}");
        assert_eq!(condition["intact"].as_u64(), Some(9 - damage.unrecorded.len() as u64), "{name}");

        let check = nacre(["--json", "check", &place.text("s")]).expect(i32::from(!damage.unrecorded.is_empty()));
        assert_eq!(&check.json(), condition, "{name}");
        nacre(["reconstruct", "polarization", &place.text("s"), "--out", &place.text("r")]).expect(0);
        let resumed = nacre(place.resume("s")).expect(0).stdout();
        assert_eq!(resumed.contains("session is complete"), damage.unrecorded.is_empty(), "{name}: {resumed}");
        assert!(data(&place.path("s")) == whole, "{name}: the data set differs");
        nacre(["check", &place.text("s")]).expect(0);
        for folder in ["s", "r"] {
            fs::remove_dir_all(place.path(folder)).unwrap();
        }
    }
}

/// A session stopped before its end can be resumed; later damage is salvaged, too, under another file name.
#[test]
fn an_unfinished_session_goes_on_and_each_damaged_journal_is_kept() {
    let place = Place::new(PLAN);
    nacre(place.capture("whole")).expect(0);
    let (mut killed, _) = nacre_tests::command();
    let status = killed.args(place.capture("s")).env("NACRE_DIE_AT", "40").output().unwrap().status;
    assert!(!status.success());
    for name in ["journal.damaged", "journal.damaged-2"] {
        let mut journal = lines(&place);
        journal[5][80] ^= 1;
        fs::write(place.path("s/journal"), journal.concat()).unwrap();
        let report = salvaged(&place, "");
        assert_eq!((&report["damaged_journal"], &report["finished"]), (&name.into(), &false.into()));
        assert!(fs::read(place.path("s").join(name)).unwrap() == journal.concat());
    }
    nacre(place.resume("s")).expect(0);
    assert!(data(&place.path("s")) == data(&place.path("whole")));
    let check = nacre(["check", &place.text("s")]).expect(0).stdout();
    assert!(check.contains("9 of 9 frames are whole") && check.contains("salvaged journal"), "{check}");
}

/// A modified frame fails verification, whatever the journal's damage.
#[test]
fn a_changed_frame_is_named() {
    let place = Place::new(PLAN);
    nacre(place.capture("s")).expect(0);
    let mut journal = lines(&place);
    journal[0][20] ^= 1;
    fs::write(place.path("s/journal"), journal.concat()).unwrap();
    let frame = place.path("s/frames/0003.png");
    let mut bytes = fs::read(&frame).unwrap();
    bytes[100] ^= 1;
    fs::write(&frame, bytes).unwrap();
    let printed = nacre(["salvage", &place.text("s")]).expect(0).stdout();
    assert!(printed.contains("8 of 9 verified") && printed.contains("0003.png: differs"), "{printed}");
    nacre(["check", &place.text("s")]).expect(1);
}

#[test]
fn salvage_refuses_what_it_cannot_improve() {
    let place = Place::new(PLAN);
    let refused = |words: &str| {
        let before = listing(&place.path("s"));
        let said = nacre(["salvage", &place.text("s")]).expect(2).stderr();
        assert!(said.contains(words), "{said}");
        assert_eq!(listing(&place.path("s")), before);
    };
    fs::create_dir(place.path("s")).unwrap();
    refused("session.json");
    fs::remove_dir(place.path("s")).unwrap();
    nacre(place.capture("s")).expect(0);
    refused("undamaged journal");
    fs::write(place.path("s/journal"), vec![0; 5000]).unwrap();
    refused("without any undamaged line");
    fs::remove_file(place.path("s/journal")).unwrap();
    refused("journal: cannot be read");
}

/// The service states the remedy, without a path.
#[test]
fn the_service_names_the_remedy() {
    let place = Place::with_bench(PLAN, BENCH);
    let service = Service::start(&place, &[]);
    let id = nacre_tests::http::begin(&service, &nacre_tests::http::plan(4, 5.0));
    nacre_tests::http::finished(&service, &id);
    let folder = place.path(&format!("data/sessions/{id}"));
    let mut journal = fs::read(folder.join("journal")).unwrap();
    journal[60] ^= 1;
    fs::write(folder.join("journal"), journal).unwrap();
    let problem = service.get(&format!("/api/v1/sessions/{id}/frames")).expect(400).json();
    assert!(problem["remedy"].as_str().unwrap().contains("nacre salvage"), "{problem}");
    assert!(!problem.to_string().contains("sessions/"), "{problem}");
    nacre(["salvage".into(), folder.to_string_lossy().into_owned()]).expect(0);
    service.get(&format!("/api/v1/sessions/{id}/frames")).expect(200);
    let stream = service.send("GET", &format!("/api/v1/sessions/{id}/events"), &[], b"").expect(200);
    assert!(stream.text().contains("frame"), "{}", stream.text());
}
