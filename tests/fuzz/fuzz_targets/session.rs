//! Session folders: `session.json`, `journal` and `frames.json`, separated by a line of `=`. Checksums of the journal's
//! lines are recomputed, because random inputs would not match them.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_capture::session::{Entry, Journal, SessionFile, check};

fuzz_target!(|text: &str| {
    nacre_fuzz::photographs();
    let mut parts = text.split("\n=\n");
    let [session, journal, frames] = std::array::from_fn(|_| parts.next().unwrap_or_default());
    nacre_fuzz::file("session.json", session.as_bytes());
    nacre_fuzz::file("frames.json", frames.as_bytes());
    let sealed = entries(journal);
    for journal in [journal, &sealed] {
        let path = nacre_fuzz::file("journal", journal.as_bytes());
        if let Ok((journal, _)) = Journal::read(&path)
            && let Ok(session) = SessionFile::read(nacre_fuzz::folder())
        {
            let [known, most] = journal.planned(&session.plan);
            assert!(known <= most);
        }
        if let Ok(condition) = check(nacre_fuzz::folder()) {
            condition.is_complete();
        }
    }
    let _ = nacre_frames::load(nacre_fuzz::folder());
});

/// A journal with the entries of these lines.
fn entries(journal: &str) -> String {
    let mut whole = Journal::default();
    let entry = |line: &str| {
        serde_json::from_value::<Entry>(serde_json::from_str::<serde_json::Value>(line).ok()?.get("entry")?.clone())
            .ok()
    };
    journal.lines().filter_map(entry).filter_map(|entry| whole.line(entry).ok()).collect()
}
