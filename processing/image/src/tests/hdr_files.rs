//! Radiance HDR files of other programs.

use super::*;

/// Picture of `width` by `height` pixels with distinct colours.
fn colours([width, height]: [usize; 2]) -> Vec<[u8; 4]> {
    (0..width * height)
        .map(|k| [(k * 7 % 256) as u8, (k * 13 % 256) as u8, 128 + (k % 100) as u8, 126 + (k % 5) as u8])
        .collect()
}

fn value([r, g, b, e]: [u8; 4]) -> [f32; 3] {
    let scale = 2.0_f32.powi(i32::from(e) - 136);
    [r, g, b].map(|m| f32::from(m) * scale)
}

fn file(header: &str, resolution: &str, pixels: &[[u8; 4]]) -> Vec<u8> {
    let mut bytes = format!("{header}\n{resolution}\n").into_bytes();
    bytes.extend(pixels.as_flattened());
    bytes
}

fn light_of(bytes: &[u8]) -> Light {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.hdr");
    fs::write(&path, bytes).unwrap();
    read_light(&path, None).unwrap()
}

fn refusal(bytes: &[u8]) -> String {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.hdr");
    fs::write(&path, bytes).unwrap();
    let words = read(&path).unwrap_err().to_string();
    assert_eq!(words, read_light(&path, None).unwrap_err().to_string());
    words
}

const HEADER: &str = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n";

#[test]
fn magic_words_and_headers() {
    let pixels = colours([5, 3]);
    let expected: Vec<[f32; 3]> = pixels.iter().map(|p| value(*p)).collect();
    for header in [
        HEADER,
        "#?RGBE\nFORMAT=32-bit_rle_rgbe\n",
        "#?AUTOPANO\n# comment\nFORMAT=32-bit_rle_rgbe\nSOFTWARE=a = b\n",
        "#?RADIANCE\r\nFORMAT=32-bit_rle_rgbe\r\n\r",
        "#?RADIANCE\nno format\n",
        "#?RADIANCE\npcomb a.hdr\n\tEXPOSURE=8\n\tFORMAT=none\nFORMAT= 32-bit_rle_rgbe \n",
    ] {
        let light = light_of(&file(header, "-Y 3 +X 5", &pixels));
        assert_eq!((light.rgb, light.notes), (expected.clone(), vec![]), "{header}");
    }
    assert!(refusal(&file("#?RADIANCE\nFORMAT=48-bit\n", "-Y 3 +X 5", &pixels)).contains("format \"48-bit\""));
    assert!(refusal(&file(HEADER, "-Y 3 +Z 5", &pixels)).contains("no resolution"));
    assert!(refusal(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n").contains("ends within its header"));
    assert!(refusal(&file(HEADER, "-Y 3 +X 5", &pixels[1..])).contains("truncated"));
    assert!(refusal(&file(HEADER, "-Y 300000 +X 5", &pixels)).contains("more than 65535"));
}

/// The eight pixel orders of the format give the same picture.
#[test]
fn all_orientations() {
    let [width, height] = [5, 3];
    let picture = colours([width, height]);
    let expected: Vec<[f32; 3]> = picture.iter().map(|p| value(*p)).collect();
    for columns in [false, true] {
        for (y, up) in [("-Y", false), ("+Y", true)] {
            for (x, left) in [("+X", false), ("-X", true)] {
                let (outer, inner) = if columns { (width, height) } else { (height, width) };
                let mut pixels = vec![];
                for i in 0..outer {
                    for j in 0..inner {
                        let [column, row] = if columns { [i, j] } else { [j, i] };
                        let column = if left { width - 1 - column } else { column };
                        let row = if up { height - 1 - row } else { row };
                        pixels.push(picture[row * width + column]);
                    }
                }
                let order =
                    if columns { format!("{x} {width} {y} {height}") } else { format!("{y} {height} {x} {width}") };
                let light = light_of(&file(HEADER, &order, &pixels));
                assert_eq!(([light.width, light.height], light.rgb), ([width, height], expected.clone()), "{order}");
            }
        }
    }
}

#[test]
fn exposures_and_corrections_multiply() {
    let pixels = colours([4, 2]);
    let header = format!("{HEADER}EXPOSURE=4\nEXPOSURE= 0.5\nCOLORCORR=1 2 4\n");
    let light = light_of(&file(&header, "-Y 2 +X 4", &pixels));
    for (pixel, found) in pixels.iter().zip(light.rgb) {
        let [r, g, b] = value(*pixel);
        assert_eq!(found, [r / 2.0, g / 4.0, b / 8.0]);
    }
    assert!(light.notes.join("").contains("(2, 4, 8)"), "{:?}", light.notes);
    // Photographs are divided by the exposure too.
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.hdr");
    fs::write(&path, file(&format!("{HEADER}EXPOSURE=2\n"), "-Y 2 +X 4", &pixels)).unwrap();
    let halves: Vec<f32> = pixels.iter().flat_map(|p| value(*p)).map(|v| v / 2.0).collect();
    assert_eq!(read(&path).unwrap().samples, Samples::F32(halves));
    for (bad, word) in [
        ("EXPOSURE=0", "product"),
        ("EXPOSURE=-1", "product"),
        ("EXPOSURE=x", "EXPOSURE=x"),
        ("COLORCORR=1 2", "not 3"),
    ] {
        assert!(refusal(&file(&format!("{HEADER}{bad}\n"), "-Y 2 +X 4", &pixels)).contains(word), "{bad}");
    }
}

#[test]
fn other_primaries_become_rec_709() {
    // X, Y, Z of D65 white and of the red primary of Rec. 709, as mantissas with one exponent.
    let quantize = |xyz: [f64; 3]| -> [u8; 4] {
        let [x, y, z] = xyz.map(|v| (v * 128.0).round() as u8);
        [x, y, z, 129]
    };
    let xyz = [quantize([0.9505, 1.0, 1.089]), quantize([0.4124, 0.2126, 0.0193])];
    let header = "#?RADIANCE\nFORMAT=32-bit_rle_xyze\nEXPOSURE=2\n";
    let light = light_of(&file(header, "-Y 1 +X 2", &xyz));
    for (found, expected) in light.rgb.iter().zip([[0.5; 3], [0.5, 0.0, 0.0]]) {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.02), "{:?}", light.rgb);
    }
    assert!(light.notes.join("; ").contains("from CIE XYZ to Rec. 709"), "{:?}", light.notes);
    // In Rec. 2020, white stays white and green is outside of Rec. 709.
    let header = format!("{HEADER}PRIMARIES= .708 .292 .170 .797 .131 .046 .3127 .3290\n");
    let light = light_of(&file(&header, "-Y 1 +X 2", &[[128, 128, 128, 129], [0, 128, 0, 129]]));
    assert!(light.rgb[0].iter().all(|v| (v - 1.0).abs() < 1e-5), "{:?}", light.rgb);
    assert!(light.rgb[1][0] == 0.0 && (light.rgb[1][1] - 1.1329).abs() < 1e-3, "{:?}", light.rgb);
    assert!(light.notes.join("").contains("50.00 % of the pixels"), "{:?}", light.notes);
    assert!(light.notes.join("").contains("Rec. 2020"));
    let line = format!("{HEADER}PRIMARIES=.1 .1 .2 .2 .3 .3 .4 .4\n");
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.hdr");
    fs::write(&path, file(&line, "-Y 1 +X 2", &xyz)).unwrap();
    assert!(read_light(&path, None).unwrap_err().to_string().contains("lie on a line"));
}

/// Picture with runs, as written by the image crate.
pub(super) fn with_runs() -> Vec<u8> {
    let [width, height] = [40, 6];
    let pixel = |k: usize| [(k / 9) as f32, 0.5, if k % width < 25 { 3.0 } else { k as f32 }];
    let rgb: Vec<::image::Rgb<f32>> = (0..width * height).map(|k| ::image::Rgb(pixel(k))).collect();
    let mut bytes = vec![];
    ::image::codecs::hdr::HdrEncoder::new(&mut bytes).encode(&rgb, width, height).unwrap();
    bytes
}

/// Runs as written and read by the image crate, and runs of the older format.
#[test]
fn runs_of_pixels() {
    let bytes = with_runs();
    let truth = ::image::load_from_memory(&bytes).unwrap().into_rgb32f();
    let light = light_of(&bytes);
    assert_eq!(light.rgb.as_flattened(), truth.as_raw().as_slice());
    // Seven pixels of one colour, 300 of another (44 and 1 times 256), and the last one.
    let [a, b, c] = [[10, 20, 30, 128], [40, 50, 60, 130], [70, 80, 90, 127]];
    let run = |n: u8| [1, 1, 1, n];
    let light = light_of(&file(HEADER, "-Y 1 +X 309", &[a, run(6), b, run(44), run(1), c, c]));
    assert_eq!((light.rgb[0], light.rgb[6], light.rgb[7]), (value(a), value(a), value(b)));
    assert_eq!((light.rgb[307], light.rgb[308]), (value(b), value(c)));
    assert!(refusal(&file(HEADER, "-Y 1 +X 20", &[a, run(20)])).contains("leaves its scanline"));
    assert!(refusal(&file(HEADER, "-Y 1 +X 20", &[run(2)])).contains("leaves its scanline"));
    assert!(refusal(&file(HEADER, "-Y 1 +X 20", &[[2, 2, 0, 21]])).contains("scanline of 21 pixels"));
    assert!(refusal(&file(HEADER, "-Y 1 +X 20", &[[2, 2, 0, 20], [200, 5, 0, 0]])).contains("leaves its scanline"));
}
