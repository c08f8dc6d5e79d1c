//! Gwyddion files.

use super::*;

pub(super) fn component(name: &str, kind: u8, data: &[u8]) -> Vec<u8> {
    [name.as_bytes(), &[0, kind], data].concat()
}

pub(super) fn object(name: &str, parts: &[Vec<u8>]) -> Vec<u8> {
    let inside = parts.concat();
    [name.as_bytes(), &[0], &(inside.len() as u32).to_le_bytes(), &inside].concat()
}

fn unit(key: &str, unit: &str) -> Vec<u8> {
    let text = [unit.as_bytes(), &[0]].concat();
    component(key, b'o', &object("GwySIUnit", &[component("unitstr", b's', &text)]))
}

pub(super) fn image(values: &[f64], z: &str) -> Vec<u8> {
    let doubles = [&(values.len() as u32).to_le_bytes()[..], &le(values, f64::to_le_bytes)].concat();
    object(
        "GwyDataField",
        &[
            component("xres", b'i', &(W as i32).to_le_bytes()),
            component("yres", b'i', &(H as i32).to_le_bytes()),
            component("xreal", b'd', &(W as f64 * PITCH * 1e-6).to_le_bytes()),
            component("yreal", b'd', &(H as f64 * PITCH * 1e-6).to_le_bytes()),
            unit("si_unit_xy", "m"),
            unit("si_unit_z", z),
            component("data", b'D', &doubles),
        ],
    )
}

pub(super) fn whole(images: &[(&str, Vec<u8>)], more: &[Vec<u8>]) -> Vec<u8> {
    let mut parts = vec![component("/filename", b's', b"x.gwy\0")];
    for (k, (title, image)) in images.iter().enumerate() {
        parts.push(component(&format!("/{k}/data"), b'o', image));
        parts.push(component(&format!("/{k}/data/title"), b's', &[title.as_bytes(), &[0]].concat()));
    }
    parts.extend_from_slice(more);
    [&b"GWYP"[..], &object("GwyContainer", &parts)].concat()
}

pub(super) fn sample() -> Vec<u8> {
    let volts = image(&NM.map(|v| -v), "V");
    whole(
        &[("Phase", volts), ("Amplitude", image(&NM.map(|v| v * 2e-9), "m")), ("Z", image(&NM.map(|v| v * 1e-9), "m"))],
        &[],
    )
}

#[test]
fn the_channel_of_heights_is_read() {
    let field = holds(&sample(), "gwy");
    assert!(field.notes.iter().any(|n| n.contains("channel Z (3 of 3")), "{:?}", field.notes);
    let other = file(&sample(), &Scale { channel: Some("amplitude".into()), ..Scale::default() }).unwrap();
    assert!((other.range_um() - 2e-3 * 86.0).abs() < 1e-9);
    let number = file(&sample(), &Scale { channel: Some("3".into()), ..Scale::default() }).unwrap();
    assert_eq!(number.um, field.um);
    for wrong in ["Phase", "nothing", "0", "4"] {
        let scale = Scale { channel: Some(wrong.into()), ..Scale::default() };
        assert!(file(&sample(), &scale).unwrap_err().to_string().contains("--channel"), "{wrong}");
    }
    refused(&whole(&[("Phase", image(&NM, "deg"))], &[]), &["no channel of heights", "Phase"]);
}

#[test]
fn masked_heights_are_gaps() {
    let mut mask = [0.0; W * H];
    let with = |mask: &[f64]| {
        let mask = component("/0/mask", b'o', &image(mask, ""));
        whole(&[("Height", image(&NM.map(|v| v * 1e-9), "m"))], &[mask])
    };
    holds(&with(&mask), "empty mask");
    mask[7] = 1.0;
    refused(&with(&mask), &["1 heights are masked", "column 2, row 1", "--fill-gaps 0.05"]);
}
