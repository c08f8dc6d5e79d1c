//! Igor binary waves.

use super::*;

/// Wave of version 5 with these labelled layers.
pub(super) fn five(layers: &[(&str, Vec<f64>)], big: bool) -> Vec<u8> {
    let word = |v: i32| if big { v.to_be_bytes() } else { v.to_le_bytes() };
    let short = |v: i16| if big { v.to_be_bytes() } else { v.to_le_bytes() };
    let double = |v: f64| if big { v.to_be_bytes() } else { v.to_le_bytes() };
    let data: Vec<u8> = layers
        .iter()
        .flat_map(|(_, v)| v)
        .flat_map(|v| if big { (*v as f32).to_be_bytes() } else { (*v as f32).to_le_bytes() })
        .collect();
    let labels: Vec<u8> = std::iter::once("")
        .chain(layers.iter().map(|(l, _)| *l))
        .flat_map(|l| {
            let mut b = [0; 32];
            b[..l.len()].copy_from_slice(l.as_bytes());
            b
        })
        .collect();
    let note = b"ScanSize: 1e-06\r";
    let mut all =
        [&short(5)[..], &short(0), &word(320 + data.len() as i32), &word(0), &word(note.len() as i32), &word(0)]
            .concat();
    [0, 0, 0, 0, 0, 0, labels.len() as i32, 0, 0, 0, 0].iter().for_each(|v| all.extend(word(*v)));
    all.extend([0; 12]);
    all.extend(word((W * H * layers.len()) as i32));
    all.extend(short(2));
    all.extend([0; 2 + 6 + 2 + 32 + 4 + 4]);
    [W as i32, H as i32, layers.len() as i32, 0].iter().for_each(|v| all.extend(word(*v)));
    [PITCH * 1e-6, PITCH * 1e-6, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0].iter().for_each(|v| all.extend(double(*v)));
    ["m", "m", "m", "", ""].iter().for_each(|u| {
        let mut b = [0; 4];
        b[..u.len()].copy_from_slice(u.as_bytes());
        all.extend(b);
    });
    all.resize(64 + 320, 0);
    [all, data, note.to_vec(), labels].concat()
}

/// Profile of version 2.
pub(super) fn two() -> Vec<u8> {
    let data = le(&NM, |v| ((v * 1e-9) as f32).to_le_bytes());
    let mut all = [&2_i16.to_le_bytes()[..], &(126 + data.len() as i32).to_le_bytes(), &[0; 10]].concat();
    all.extend(2_i16.to_le_bytes());
    all.extend([0; 4 + 20 + 2 + 2 + 4]);
    all.extend(*b"m\0\0\0m\0\0\0");
    all.extend((NM.len() as i32).to_le_bytes());
    all.extend([0; 2]);
    all.extend((PITCH * 1e-6).to_le_bytes());
    all.resize(16 + 110, 0);
    [all, data, vec![0; 16]].concat()
}

pub(super) fn sample(big: bool) -> Vec<u8> {
    let metres: Vec<f64> = lowest_first().iter().map(|v| v * 1e-9).collect();
    let phase = metres.iter().map(|v| v * 1e10).collect();
    five(&[("PhaseRetrace", phase), ("HeightRetrace", metres)], big)
}

#[test]
fn waves_of_both_byte_orders_are_read() {
    for big in [false, true] {
        let field = holds(&sample(big), "ibw");
        assert!(field.notes.iter().any(|n| n.contains("HeightRetrace (2 of 2")), "{:?}", field.notes);
    }
    refused(&five(&[("PhaseRetrace", NM.to_vec())], false), &["no channel of heights"]);
    let field = file(&two(), &Scale::default()).unwrap();
    assert_eq!((field.width, field.height), (W * H, 1));
    assert!((field.range_um() - 0.086).abs() < 1e-8 && (field.pixel_um - PITCH).abs() < 1e-9);
}
