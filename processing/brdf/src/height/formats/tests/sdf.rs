//! SDF files.

use super::*;

pub(super) fn text(magic: &str, data: &str) -> Vec<u8> {
    format!(
        "{magic}\nManufacID   = other\nCreateDate = 010120250000\nModDate = 010120250000\nNumPoints = {W}\nNumProfiles = {H}\n\
         Xscale = {0:e}\nYscale = {0:e}\nZscale = 1e-9\nZresolution = 1e-12\nCompression = 0\nDataType = 7\nCheckType = 0\n*\n{data}",
        PITCH * 1e-6
    )
    .into_bytes()
}

pub(super) fn binary(magic: &[u8], kind: u8, data: &[u8]) -> Vec<u8> {
    let pitch = (PITCH * 1e-6).to_le_bytes();
    let head = [magic, &[b' '; 34], &(W as u16).to_le_bytes(), &(H as u16).to_le_bytes(), &pitch, &pitch];
    [head.concat(), 1e-9_f64.to_le_bytes().to_vec(), 1e-12_f64.to_le_bytes().to_vec(), vec![0, kind, 0], data.to_vec()]
        .concat()
}

pub(super) fn numbers() -> String {
    lowest_first().chunks(W).map(|r| r.iter().map(|v| format!("{v} ")).collect::<String>() + "\n").collect()
}

#[test]
fn text_and_binary_are_read() {
    for magic in ["aISO-1.0", "aBCR-1.0"] {
        holds(&text(magic, &(numbers() + "*\n")), magic);
        // Without the end mark, with a trailer, wrapped, and with decimal commas.
        holds(&text(magic, &numbers()), magic);
        holds(&text(magic, &(numbers() + "*\n<note>1 2 3</note>\n*")), magic);
        holds(&text(magic, &numbers().replace(' ', "\n")), magic);
        holds(&text(magic, &numbers().replace(' ', ",00 ")), magic);
    }
    let up = lowest_first();
    holds(&binary(b"bISO-1.0", 7, &le(&up, f64::to_le_bytes)), "double");
    holds(&binary(b"bBCR-1.0", 5, &le(&up, |v| (v as i16).to_le_bytes())), "i16");
    holds(&binary(b"bISO-1.0", 6, &le(&up, |v| (v as i32).to_le_bytes())), "i32");
    holds(&binary(b"bISO-1.0", 3, &le(&up, |v| (v as f32).to_le_bytes())), "float");
}

#[test]
fn gaps_and_wrong_counts_are_refused() {
    refused(&text("aISO-1.0", &numbers().replacen("79", "BAD", 1)), &["1 heights are bad points", "column 1, row 3"]);
    refused(&text("aISO-1.0", &numbers().replacen("79 ", "", 1)), &["truncated SDF", "20 heights expected, 19 found"]);
    refused(&text("aISO-1.0", &(numbers() + "5 *")), &["damaged SDF", "more than 5 x 4"]);
    refused(&text("aISO-1.0", &numbers().replacen("79", "high", 1)), &["damaged SDF", "high"]);
    let up = le(&lowest_first(), |v| (if v == 79.0 { f64::from(i16::MIN) } else { v } as i16).to_le_bytes());
    refused(&binary(b"bISO-1.0", 5, &up), &["bad points", "column 1, row 3"]);
    refused(&binary(b"bISO-1.0", 5, &up[1..]), &["truncated SDF"]);
    refused(&binary(b"bISO-1.0", 9, &up), &["DataType 9"]);
}
