//! Files of each format, written here, read as what they hold; damaged ones end in errors.

use super::super::stored::{Pitch, Stored};
use super::super::{HeightField, Scale, read};
use super::{FORMATS, Input, recognise};
use std::io::Write;

/// Heights in nm of a patch whose corners all differ, row 0 on top.
const W: usize = 5;
const H: usize = 4;
const NM: [f64; W * H] =
    [11., 12., 14., 18., 26., 31., 37., 41., 43., 47., 53., 59., 61., 67., 71., 73., 79., 83., 89., 97.];
/// Pitch in µm.
const PITCH: f64 = 0.2;

/// The rows from the lowest to the highest.
fn lowest_first() -> Vec<f64> {
    NM.chunks(W).rev().flatten().copied().collect()
}

fn file(bytes: &[u8], scale: &Scale) -> nacre_base::Result<HeightField> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("measured");
    std::fs::write(&path, bytes).unwrap();
    read(&path, scale)
}

/// Reads the bytes and compares them with the patch.
fn holds(bytes: &[u8], what: &str) -> HeightField {
    let field = file(bytes, &Scale::default()).unwrap_or_else(|e| panic!("{what}: {e}"));
    assert_eq!((field.width, field.height), (W, H), "{what}");
    assert!((field.pixel_um - PITCH).abs() < 1e-9, "{what}: {}", field.pixel_um);
    let [low, _] = field.ends_um();
    for (found, nm) in field.um.iter().zip(NM) {
        assert!((found - low - 1e-3 * (nm - NM[0])).abs() < 1e-8, "{what}: {:?}", field.um);
    }
    field
}

fn refused(bytes: &[u8], words: &[&str]) {
    let problem = file(bytes, &Scale::default()).unwrap_err().to_string();
    assert!(words.iter().all(|w| problem.contains(w)), "{words:?}: {problem}");
}

fn le<const N: usize>(values: &[f64], number: impl Fn(f64) -> [u8; N]) -> Vec<u8> {
    values.iter().flat_map(|v| number(*v)).collect()
}

mod gwyddion {
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
            &[
                ("Phase", volts),
                ("Amplitude", image(&NM.map(|v| v * 2e-9), "m")),
                ("Z", image(&NM.map(|v| v * 1e-9), "m")),
            ],
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
        refused(&with(&mask), &["1 heights are masked", "column 2, row 1", "Gwyddion"]);
    }
}

mod igor {
    use super::*;

    /// A wave of version 5 with these layers, each with its label.
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

    /// A profile of version 2.
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
}

mod x3p {
    use super::*;

    pub(super) fn archive(files: &[(&str, &[u8])]) -> Vec<u8> {
        let mut zip = zip::ZipWriter::new(std::io::Cursor::new(vec![]));
        let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
        for (name, data) in files {
            zip.start_file(*name, options).unwrap();
            zip.write_all(data).unwrap();
        }
        zip.finish().unwrap().into_inner()
    }

    pub(super) fn xml(kind: &str, increment: &str, data: &str) -> String {
        let axis = |name: &str, kind: &str, more: &str| format!("<{name}><AxisType>{kind}</AxisType>{more}</{name}>");
        let pitch = format!("<DataType>I</DataType><Increment>{:e}</Increment><Offset>0</Offset>", PITCH * 1e-6);
        let z = format!("<DataType>{kind}</DataType>{increment}");
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?><p:ISO5436_2 xmlns:p=\"http://www.opengps.eu/2008/ISO5436_2\"><Record1><Revision>ISO5436 - 2000</Revision>\
             <FeatureType>SUR</FeatureType><Axes>{}{}{}</Axes></Record1><Record3><MatrixDimension><SizeX>{W}</SizeX><SizeY>{H}</SizeY>\
             <SizeZ>1</SizeZ></MatrixDimension>{data}</Record3></p:ISO5436_2>",
            axis("CX", "I", &pitch),
            axis("CY", "I", &pitch),
            axis("CZ", "A", &z)
        )
    }

    const LINK: &str = "<DataLink><PointDataLink>bindata/data.bin</PointDataLink></DataLink>";

    pub(super) fn sample(kind: &str) -> Vec<u8> {
        let up = lowest_first();
        let metres: Vec<f64> = up.iter().map(|v| v * 1e-9).collect();
        let (data, increment) = match kind {
            "D" => (le(&metres, f64::to_le_bytes), ""),
            "F" => (le(&metres, |v| (v as f32).to_le_bytes()), ""),
            "I" => (le(&up, |v| (v as i16 - 50).to_le_bytes()), "<Increment>1e-9</Increment>"),
            _ => (le(&up, |v| (v as i32 - 50).to_le_bytes()), "<Increment>1e-9</Increment>"),
        };
        archive(&[("main.xml", xml(kind, increment, LINK).as_bytes()), ("bindata/data.bin", &data)])
    }

    pub(super) fn listed() -> Vec<u8> {
        let datums: String = lowest_first().iter().map(|v| format!("<Datum>{:e}</Datum>", v * 1e-9)).collect();
        archive(&[("main.xml", xml("D", "", &format!("<DataList>{datums}</DataList>")).as_bytes())])
    }

    #[test]
    fn binary_and_listed_heights_are_read() {
        for kind in ["D", "F", "I", "L"] {
            holds(&sample(kind), kind);
        }
        holds(&listed(), "list");
    }

    #[test]
    fn unsigned_integers_are_told_from_signed_ones() {
        let data = le(&lowest_first(), |v| (v as u16 * 100 + 28_000).to_le_bytes());
        let text = xml("I", "<Increment>1e-11</Increment>", LINK);
        let field = holds(&archive(&[("main.xml", text.as_bytes()), ("bindata/data.bin", &data)]), "unsigned");
        assert!((field.range_um() - 0.086).abs() < 1e-9);
    }

    #[test]
    fn gaps_sizes_and_other_archives_are_refused() {
        let data = le(&lowest_first(), f64::to_le_bytes);
        let valid = "<DataLink><PointDataLink>d.bin</PointDataLink><ValidPointsLink>v.bin</ValidPointsLink></DataLink>";
        let text = xml("D", "<Increment>1e-9</Increment>", valid);
        let with = |valid: &[u8]| archive(&[("main.xml", text.as_bytes()), ("d.bin", &data), ("v.bin", valid)]);
        holds(&with(&[0xff; 3]), "all valid");
        refused(&with(&[0xff, 0xfd, 0xff]), &["1 heights are invalid points", "column 4, row 2"]);
        refused(&with(&[0xff]), &["truncated"]);
        let short = archive(&[("main.xml", xml("D", "", LINK).as_bytes()), ("bindata/data.bin", &data[..80])]);
        refused(&short, &["truncated", "160 bytes"]);
        refused(&archive(&[("mimetype", b"application/vnd")]), &["another ZIP archive", "not supported"]);
        let cloud = xml("D", "", LINK).replace("SUR", "PCL");
        refused(&archive(&[("main.xml", cloud.as_bytes())]), &["cloud of points"]);
        let turned = xml("D", "", LINK).replace("<Axes>", "<Axes><Rotation><r11>0</r11><r12>1</r12></Rotation>");
        refused(&archive(&[("main.xml", turned.as_bytes())]), &["rotated"]);
        // A bomb: the file says more than the heights need.
        let bomb = archive(&[("main.xml", xml("D", "", LINK).as_bytes()), ("bindata/data.bin", &vec![0; 1 << 20])]);
        refused(&bomb, &["at most 4256 expected"]);
    }
}

mod nanoscope {
    use super::*;

    /// One image of heights behind one of deflection; `stated` bytes in the header, `size` in the data.
    pub(super) fn sample(stated: usize, size: usize) -> Vec<u8> {
        const BEGIN: usize = 4096;
        let full = 2_f64.powi(8 * stated as i32);
        // 50 nm/V, full scale 8 V.
        let raw: Vec<f64> = lowest_first().iter().map(|nm| (nm / 50.0 / 8.0 * full).round()).collect();
        let data =
            if size == 4 { le(&raw, |v| (v as i32).to_le_bytes()) } else { le(&raw, |v| (v as i16).to_le_bytes()) };
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
}

mod sdf {
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
        [
            head.concat(),
            1e-9_f64.to_le_bytes().to_vec(),
            1e-12_f64.to_le_bytes().to_vec(),
            vec![0, kind, 0],
            data.to_vec(),
        ]
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
        refused(
            &text("aISO-1.0", &numbers().replacen("79", "BAD", 1)),
            &["1 heights are bad points", "column 1, row 3"],
        );
        refused(
            &text("aISO-1.0", &numbers().replacen("79 ", "", 1)),
            &["truncated SDF", "20 heights expected, 19 found"],
        );
        refused(&text("aISO-1.0", &(numbers() + "5 *")), &["damaged SDF", "more than 5 x 4"]);
        refused(&text("aISO-1.0", &numbers().replacen("79", "high", 1)), &["damaged SDF", "high"]);
        let up = le(&lowest_first(), |v| (if v == 79.0 { f64::from(i16::MIN) } else { v } as i16).to_le_bytes());
        refused(&binary(b"bISO-1.0", 5, &up), &["bad points", "column 1, row 3"]);
        refused(&binary(b"bISO-1.0", 5, &up[1..]), &["truncated SDF"]);
        refused(&binary(b"bISO-1.0", 9, &up), &["DataType 9"]);
    }
}

mod others {
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
        let data = if kind == "bcrf" {
            le(&NM, |v| (v as f32).to_le_bytes())
        } else {
            le(&NM, |v| (v as i16 * 2).to_le_bytes())
        };
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
                |pixel_um, range_um| Scale { pixel_um: Some(pixel_um), range_um: Some(range_um), channel: None };
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
}

#[test]
fn flags_that_contradict_a_file_are_refused() {
    let bytes = gwyddion::sample();
    let with =
        |pixel_um: Option<f64>, range_um: Option<f64>| file(&bytes, &Scale { pixel_um, range_um, channel: None });
    assert!(with(Some(0.2005), Some(0.088)).is_ok());
    let problem = |result: nacre_base::Result<HeightField>| result.unwrap_err().to_string();
    let pitch = problem(with(Some(0.21), None));
    assert!(pitch.contains("pixels of 0.2") && pitch.contains("--pixel-um says 0.21"), "{pitch}");
    let range = problem(with(None, Some(0.15)));
    assert!(range.contains("spans 0.086") && range.contains("--range-um says 0.15"), "{range}");
}

/// All formats, one or more files of each.
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

/// Reads bytes by the reader that recognises them. What comes out is a grid of its size.
fn attempt(bytes: &[u8]) {
    let Some(format) = recognise(bytes) else { return };
    if let Ok(Stored { width, rows, values, pitch, .. }) = (format.read)(&Input { bytes, channel: None }) {
        assert_eq!(values.len(), width * rows, "{}", format.name);
        assert!(pitch != Pitch::Unknown, "{}", format.name);
    }
}

/// Flips, cuts, extensions and large counts in every place, NACRE_FUZZ_ROUNDS of each file.
#[test]
fn damaged_files_end_in_errors() {
    let rounds = std::env::var("NACRE_FUZZ_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(1500);
    for (seed, whole) in samples().into_iter().enumerate() {
        let mut state = 0x9e37_79b9_7f4a_7c15_u64.wrapping_mul(seed as u64 + 1);
        let mut dice = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize
        };
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
