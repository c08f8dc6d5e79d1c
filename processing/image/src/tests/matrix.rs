//! Files that other programs wrote, with the values that these programs read from them (`tests/formats/run`).

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crate::{Raster, Samples, read};

/// Differences of all values; `None` if types or sizes differ.
fn differences(raster: &Raster, kind: &str, truth: &[u8]) -> Option<Vec<f64>> {
    let floats = || truth.as_chunks().0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect();
    let words = || truth.as_chunks().0.iter().map(|b| f64::from(u16::from_le_bytes(*b))).collect();
    let (found, truth): (Vec<f64>, Vec<f64>) = match (&raster.samples, kind) {
        (Samples::U8(v), "u1") => {
            (v.iter().map(|v| (*v).into()).collect(), truth.iter().map(|v| (*v).into()).collect())
        }
        (Samples::U16(v), "u2") => (v.iter().map(|v| (*v).into()).collect(), words()),
        (Samples::F32(v), "f4") => (v.iter().map(|v| (*v).into()).collect(), floats()),
        _ => return None,
    };
    (found.len() == truth.len()).then(|| found.iter().zip(&truth).map(|(a, b)| (a - b).abs()).collect())
}

/// Largest difference, or NaN if any is NaN; `inside` excludes the last row and column.
fn largest(raster: &Raster, differences: &[f64], inside: bool) -> f64 {
    let less = usize::from(inside);
    let rows = differences.chunks(raster.width * raster.channels).take(raster.height - less);
    let counted = rows.flat_map(|row| &row[..(raster.width - less) * raster.channels]);
    counted.fold(0.0, |most, d| if d.is_nan() { *d } else { most.max(*d) })
}

/// Outcome of a file: equal, or refused by name. Errors are violated expectations.
fn outcome(path: &Path, expectation: &str, channels: usize, kind: &str) -> Result<&'static str, String> {
    match (read(path), expectation.split_once(' ').unwrap_or((expectation, "0"))) {
        (Err(error), ("refused", words)) => {
            let said = error.to_string();
            let named = said.contains(words) && !said.contains("damaged") && !said.contains("makes its decoder fail");
            if named { Ok("refused") } else { Err(format!("does not say {words:?}: {said}")) }
        }
        (Err(error), _) => Err(format!("is not read: {error}")),
        (Ok(_), ("refused", words)) => Err(format!("is read, not refused with {words:?}")),
        (Ok(raster), (_, bound)) => {
            let truth = fs::read(path.with_added_extension("raw")).unwrap();
            let (bound, inside) = bound.split_once(' ').map_or((bound, false), |(bound, _)| (bound, true));
            let bound: f64 = bound.parse().unwrap();
            let differences = if raster.channels == channels { differences(&raster, kind, &truth) } else { None };
            let most = differences.map_or(f64::INFINITY, |all| largest(&raster, &all, inside));
            if most <= bound { Ok("right") } else { Err(format!("is off by {most}, not at most {bound}")) }
        }
    }
}

#[test]
fn matrix_of_formats() {
    let Some(folder) = std::env::var_os("NACRE_FORMATS_MATRIX") else {
        println!("skipped: no NACRE_FORMATS_MATRIX (tests/formats/run sets it)");
        return;
    };
    let folder = Path::new(&folder);
    let index = fs::read_to_string(folder.join("index.tsv")).unwrap();
    let (mut counts, mut wrong) = (BTreeMap::<_, usize>::new(), vec![]);
    for line in index.lines() {
        let fields: Vec<&str> = line.split('\t').collect();
        let [name, format, row, expectation, channels, kind] = fields[..] else { panic!("{line}") };
        match outcome(&folder.join(name), expectation, channels.parse().unwrap(), kind) {
            Ok(outcome) => *counts.entry((format, outcome)).or_default() += 1,
            Err(words) => wrong.push(format!("{format}, {row}: {name} {words}")),
        }
    }
    for ((format, outcome), count) in counts {
        println!("{format}: {count} files {outcome}");
    }
    assert!(wrong.is_empty(), "{} files:\n{}", wrong.len(), wrong.join("\n"));
}
