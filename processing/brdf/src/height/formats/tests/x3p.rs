//! X3P archives.

use super::*;
use std::io::Write;

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
    refused(&archive(&[("mimetype", b"application/vnd")]), &["does not read", "ZIP archive"]);
    let cloud = xml("D", "", LINK).replace("SUR", "PCL");
    refused(&archive(&[("main.xml", cloud.as_bytes())]), &["cloud of points"]);
    let turned = xml("D", "", LINK).replace("<Axes>", "<Axes><Rotation><r11>0</r11><r12>1</r12></Rotation>");
    refused(&archive(&[("main.xml", turned.as_bytes())]), &["rotated"]);
    // A decompression bomb: the file is larger than its heights need.
    let bomb = archive(&[("main.xml", xml("D", "", LINK).as_bytes()), ("bindata/data.bin", &vec![0; 1 << 20])]);
    refused(&bomb, &["at most 4256 expected"]);
}
