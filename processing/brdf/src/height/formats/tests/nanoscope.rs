//! Nanoscope files.

use super::*;

/// An image of heights after one of deflection; `stated` bytes in the header, `size` in the data.
pub(super) fn sample(stated: usize, size: usize) -> Vec<u8> {
    const BEGIN: usize = 4096;
    let full = 2_f64.powi(8 * stated as i32);
    // 50 nm/V, full scale 8 V.
    let raw: Vec<f64> = lowest_first().iter().map(|nm| (nm / 50.0 / 8.0 * full).round()).collect();
    let data = if size == 4 { le(&raw, |v| (v as i32).to_le_bytes()) } else { le(&raw, |v| (v as i16).to_le_bytes()) };
    let list = |name: &str, sens: &str, k: usize| {
        format!(
            "\\*Ciao image list\r\n\\Data offset: {}\r\n\\Data length: {}\r\n\\Bytes/pixel: {stated}\r\n\\Samps/line: {W}\r\n\
             \\Number of lines: {H}\r\n\\Scan Size: {:.1} {:.1} ~m\r\n\\@2:Image Data: S [{name}] \"{name}\"\r\n\
             \\@2:Z scale: V [Sens. {sens}] (0.000122 V/LSB) 8.000 V\r\n",
            BEGIN + k * data.len(),
            data.len(),
            W as f64 * PITCH,
            H as f64 * PITCH
        )
    };
    let mut all = format!(
        "\\*File list\r\n\\Version: 0x09300201\r\n\\*Scanner list\r\n\\@Sens. Zsens: V 50.00 nm/V\r\n\\@Sens. Deflection: V 9.0 nm/V\r\n{}{}\\*File list end\r\n",
        list("Deflection Error", "Deflection", 0),
        list("Height Sensor", "Zsens", 1)
    )
    .into_bytes();
    all.resize(BEGIN, 0x1a);
    [all, vec![7; data.len()], data].concat()
}

#[test]
fn images_of_16_and_32_bits_are_read() {
    for [stated, size] in [[4, 4], [4, 4]] {
        let field = holds(&sample(stated, size), "nanoscope");
        assert!(field.notes.iter().any(|n| n.contains("Height Sensor (2 of 2")), "{:?}", field.notes);
    }
    // 400 nm over 65536 steps.
    for [stated, size] in [[2, 2], [2, 4]] {
        let field = file(&sample(stated, size), &Scale::default()).unwrap();
        assert!(field.um.iter().zip(NM).all(|(um, nm)| (um * 1e3 - nm).abs() < 0.004), "{:?}", field.um);
    }
    refused(b"\\*Force file list\r\n", &["force curves", "not supported"]);
    refused(b"\\*File list\r\n\\Version: 0x04220100\r\n\\*Image list\r\n", &["4.3"]);
    let whole = sample(2, 2);
    refused(&whole[..whole.len() - 1], &["truncated Nanoscope"]);
}
