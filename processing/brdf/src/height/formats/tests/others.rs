//! Nanosurf, Surfer and BCR files, and unsupported formats.

use super::*;

pub(super) fn nid() -> Vec<u8> {
    // 200 nm over 16 bits.
    let raw: Vec<i16> = lowest_first().iter().map(|nm| (nm / 200.0 * 65536.0).round() as i16).collect();
    let data: Vec<u8> = raw.iter().flat_map(|v| v.to_le_bytes()).collect();
    let set = |name: &str, unit: &str| {
        format!(
            "[{name}]\r\nVersion=2\r\nPoints={W}\r\nLines={H}\r\nFrame=Scan forward\r\nDim0Unit=m\r\nDim0Range={:e}\r\nDim1Unit=m\r\nDim1Range={:e}\r\n\
             Dim2Name=Z-Axis\r\nDim2Unit={unit}\r\nDim2Range=2e-7\r\nDim2Min=-1e-7\r\nSaveMode=Binary\r\nSaveBits=16\r\nSaveSign=Signed\r\nSaveOrder=Intel\r\n",
            W as f64 * PITCH * 1e-6,
            H as f64 * PITCH * 1e-6
        )
    };
    let head = format!(
        "[DataSet]\r\nVersion=2\r\nGroupCount=1\r\nGr0-Count=3\r\nGr0-Ch0=DataSet-0:0\r\nGr0-Ch2=DataSet-0:2\r\n{}{}",
        set("DataSet-0:0", "V"),
        set("DataSet-0:2", "m")
    );
    [head.as_bytes(), b"#!", &vec![3; data.len()], &data].concat()
}

pub(super) fn dsaa() -> Vec<u8> {
    let rows: String =
        lowest_first().chunks(W).map(|r| r.iter().map(|v| format!("{v} ")).collect::<String>() + "\n\n").collect();
    format!("DSAA\n{W} {H}\n0 {}\n0 {}\n11 97\n{rows}", (W - 1) as f64 * PITCH, (H - 1) as f64 * PITCH).into_bytes()
}

pub(super) fn dsbb() -> Vec<u8> {
    let mut all = [&b"DSBB"[..], &(W as i16).to_le_bytes(), &(H as i16).to_le_bytes()].concat();
    [0.0, (W - 1) as f64 * PITCH, 0.0, (H - 1) as f64 * PITCH, 11.0, 97.0]
        .iter()
        .for_each(|v| all.extend(v.to_le_bytes()));
    [all, le(&lowest_first(), |v| (v as f32).to_le_bytes())].concat()
}

pub(super) fn bcr(kind: &str, wide: bool) -> Vec<u8> {
    let size = 2048;
    let head = format!(
        "fileformat = {kind}\nheadersize = {size}\nxpixels = {W}\nypixels = {H}\nxlength = {}\nylength = {}\nxunit = nm\nyunit = nm\nzunit = nm\n\
         bit2nm = {}\nintelmode = 1\nvoidpixels = 0\n",
        W as f64 * PITCH * 1e3,
        H as f64 * PITCH * 1e3,
        if kind == "bcrf" { "1" } else { "0.5" }
    );
    let mut head: Vec<u8> =
        if wide { head.encode_utf16().flat_map(u16::to_le_bytes).collect() } else { head.into_bytes() };
    head.resize(if wide { 2 * size } else { size }, b'%');
    let data =
        if kind == "bcrf" { le(&NM, |v| (v as f32).to_le_bytes()) } else { le(&NM, |v| (v as i16 * 2).to_le_bytes()) };
    [head, data].concat()
}

#[test]
fn nanosurf_surfer_and_bcr_are_read() {
    let field = file(&nid(), &Scale::default()).unwrap();
    assert!((field.pixel_um - PITCH).abs() < 1e-9);
    assert!(field.um.iter().zip(NM).all(|(um, nm)| (um * 1e3 - nm).abs() < 0.002), "{:?}", field.um);
    for bytes in [bcr("bcrf", false), bcr("bcrstm", false), bcr("bcrf", true)] {
        holds(&bytes, "bcr");
    }
    for bytes in [dsaa(), dsbb()] {
        let scale =
            |pixel_um, range_um| Scale { pixel_um: Some(pixel_um), range_um: Some(range_um), ..Scale::default() };
        let field = file(&bytes, &scale(PITCH, 0.086)).unwrap();
        assert!(field.um.iter().zip(NM).all(|(um, nm)| (um * 1e3 - nm).abs() < 1e-6), "{:?}", field.um);
        refused(&bytes, &["unit", "--pixel-um"]);
        assert!(file(&bytes, &scale(0.3, 0.086)).unwrap_err().to_string().contains("--pixel-um says 0.3"));
        assert!(file(&bytes, &scale(200.0 * 1e-3, 0.086)).is_ok());
    }
    let text = String::from_utf8(dsaa()).unwrap();
    refused(text.replace("11 97", "11 99").as_bytes(), &["header says from 11 to 99"]);
    refused(text.replace(" 79 ", " 1.70141e38 ").as_bytes(), &["1 heights are blank"]);
    refused(text.replace(" 79 ", " ").as_bytes(), &["truncated Surfer"]);
}

#[test]
fn formats_that_are_not_read_are_named() {
    refused(b"DIGITAL SURF\0\0\0", &["Digital Surf"]);
    refused(b"\x89HDF\r\n\x1a\n\0\0", &["HDF5"]);
    refused(b"VK4_\0\0\0", &["Keyence"]);
    refused(b"WSxM file copyright Nanotec", &["WSxM"]);
    refused(b"DSRB\0\0", &["Surfer 7", "DSAA"]);
    refused(b"GWYO\0\0", &["Gwyddion 1"]);
    refused(&[0, 1, 2, 3, 4, 5], &["no format that Nacre knows"]);
}
