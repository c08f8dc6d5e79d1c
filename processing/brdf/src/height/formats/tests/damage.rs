//! Recognition of all formats, and damaged files of each.

use super::super::super::stored::{Pitch, Stored};
use super::super::{FORMATS, Input, recognise};
use super::*;

/// Files of all formats, at least one of each.
fn samples() -> Vec<Vec<u8>> {
    vec![
        gwyddion::sample(),
        igor::sample(false),
        igor::sample(true),
        igor::two(),
        x3p::sample("D"),
        x3p::sample("I"),
        x3p::listed(),
        nanoscope::sample(2, 2),
        nanoscope::sample(4, 4),
        sdf::text("aISO-1.0", &sdf::numbers()),
        sdf::binary(b"bISO-1.0", 7, &le(&NM, f64::to_le_bytes)),
        others::nid(),
        others::dsaa(),
        others::dsbb(),
        others::bcr("bcrf", false),
        others::bcr("bcrstm", true),
    ]
}

#[test]
fn every_format_is_recognised_by_its_content() {
    let mut seen: Vec<&str> = samples().iter().map(|bytes| recognise(bytes).unwrap().name).collect();
    seen.dedup();
    assert_eq!(seen, FORMATS.iter().map(|f| f.name).collect::<Vec<_>>());
}

/// Reads bytes by the reader that recognises them. The result is a grid of its stated size.
fn attempt(bytes: &[u8]) {
    let Some(format) = recognise(bytes) else { return };
    if let Ok(Stored { width, rows, values, pitch, .. }) = (format.read)(&Input { bytes, channel: None }) {
        assert_eq!(values.len(), width * rows, "{}", format.name);
        assert!(pitch != Pitch::Unknown, "{}", format.name);
    }
}

/// Pseudorandom numbers.
fn dice(seed: usize) -> impl FnMut() -> usize {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64.wrapping_mul(seed as u64 + 1);
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize
    }
}

/// Flips, cuts, extensions and large counts anywhere, NACRE_FUZZ_ROUNDS of each file.
#[test]
fn damaged_files_end_in_errors() {
    let rounds = std::env::var("NACRE_FUZZ_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(1500);
    for (seed, whole) in samples().into_iter().enumerate() {
        let mut dice = dice(seed);
        for length in 0..whole.len().min(6000) {
            attempt(&whole[..length]);
        }
        for round in 0..rounds {
            let mut copy = whole.clone();
            for _ in 0..=dice() % 3 {
                let at = dice() % copy.len();
                match dice() % 5 {
                    0 => copy[at] ^= 1 << (dice() % 8),
                    1 => copy[at] = dice() as u8,
                    2 => copy[at..].iter_mut().take(4).for_each(|b| *b = 0xff),
                    3 => copy[at..].iter_mut().take(4).zip([0xff, 0xff, 0xff, 0x7f]).for_each(|(b, v)| *b = v),
                    _ => copy[at..].iter_mut().take(3).for_each(|b| *b = b'9'),
                }
            }
            match round % 8 {
                0 => copy.truncate(dice() % whole.len()),
                1 => copy.extend(std::iter::repeat_n(dice() as u8, 300)),
                _ => {}
            }
            attempt(&copy);
        }
    }
}

/// The archive is intact, the files in it are damaged.
#[test]
fn damaged_documents_in_whole_archives_end_in_errors() {
    let rounds = std::env::var("NACRE_FUZZ_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(600);
    let data = le(&NM, f64::to_le_bytes);
    let list: String = NM.iter().map(|v| format!("<Datum>0;1;{v}e-9</Datum>")).collect();
    let link = "<DataLink><PointDataLink>d</PointDataLink><ValidPointsLink>v</ValidPointsLink></DataLink>".to_owned();
    for (seed, part) in [format!("<DataList>{list}</DataList>"), link].iter().enumerate() {
        let whole = x3p::xml("D", "<Increment>1</Increment>", part).into_bytes();
        let mut dice = dice(seed);
        for _ in 0..rounds {
            let mut xml = whole.clone();
            for _ in 0..=dice() % 3 {
                let at = dice() % xml.len();
                let digits = xml[at].is_ascii_digit();
                xml[at] = if digits { b"0987-e."[dice() % 7] } else { dice() as u8 };
            }
            attempt(&x3p::archive(&[("main.xml", &xml), ("d", &data), ("v", &[0xff; 3])]));
        }
    }
}
