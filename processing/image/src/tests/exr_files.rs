//! OpenEXR files of other programs: windows, layers, primaries and subsampled channels.

use super::*;
use exr::meta::attribute::{Chromaticities, EnvironmentMap};
use exr::prelude::Encoding;
use exr::prelude::*;

/// Layer of 32-bit channels, whose samples are a function of channel, column and row.
fn layer(
    size: [usize; 2],
    name: Option<&str>,
    channels: &[&str],
    value: impl Fn(usize, usize, usize) -> f32,
) -> Layer<AnyChannels<FlatSamples>> {
    let [width, height] = size;
    let list = channels.iter().enumerate().map(|(c, name)| {
        let samples = (0..width * height).map(|k| value(c, k % width, k / width)).collect();
        AnyChannel::new(*name, FlatSamples::F32(samples))
    });
    let attributes = LayerAttributes { layer_name: name.map(Text::from), ..Default::default() };
    Layer::new((width, height), attributes, Encoding::FAST_LOSSLESS, AnyChannels::sort(list.collect()))
}

fn write_layers(path: &Path, layers: Vec<Layer<AnyChannels<FlatSamples>>>, change: impl Fn(&mut ImageAttributes)) {
    let mut attributes = ImageAttributes::with_size(layers[0].size);
    change(&mut attributes);
    Image { attributes, layer_data: layers.into_iter().collect::<Layers<_>>() }.write().to_file(path).unwrap();
}

fn rgb(c: usize, x: usize, y: usize) -> f32 {
    (100 * c + 10 * y + x) as f32 + 1.0
}

/// Data windows within, beyond and across the display window.
#[test]
fn windows() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.exr");
    let [width, height] = [8, 4];
    for ([x0, y0], [w, h], [dx, dy]) in [
        ([2, 1], [3, 2], [0, 0]),
        ([-3, -2], [20, 9], [0, 0]),
        ([-1, 2], [4, 5], [0, 0]),
        ([7, 3], [9, 9], [0, 0]),
        ([12, 21], [3, 2], [10, 20]),
        ([0, 0], [8, 4], [0, 0]),
        ([-10, -20], [8, 4], [-10, -20]),
    ] {
        let mut inner = layer([w, h], None, &["R", "G", "B"], rgb);
        inner.attributes.layer_position = Vec2(x0, y0);
        write_layers(&path, vec![inner], |all| {
            all.display_window = IntegerBounds::new(Vec2(dx, dy), Vec2(width, height));
        });
        assert_eq!(size(&path).unwrap(), [width, height]);
        assert_eq!(info(&path).unwrap(), Info { width, height, channels: 3, depth: Depth::F32 });
        let light = read_light(&path, None).unwrap();
        let map = read_exr(&path).unwrap();
        let Samples::F32(photograph) = crate::read(&path).unwrap().samples else { panic!("no floats") };
        for k in 0..width * height {
            let [x, y] = [(k % width) as i32 + dx - x0, (k / width) as i32 + dy - y0];
            let stored = (0..w as i32).contains(&x) && (0..h as i32).contains(&y);
            let expected = [0, 1, 2].map(|c| if stored { rgb(c, x as usize, y as usize) } else { 0.0 });
            assert_eq!(light.rgb[k], expected, "{x0} {y0} {k}");
            assert_eq!(photograph[3 * k..3 * k + 3], expected);
            let red = map.channels["R"][k];
            assert!(if stored { red == expected[0] } else { red.is_nan() });
        }
        let said = light.notes.join("; ");
        let plain = [x0, y0] == [dx, dy] && [w, h] == [width, height];
        assert_eq!(said.contains("data window"), !plain, "{said}");
        let holes = x0 > dx || y0 > dy || x0 + (w as i32) < dx + 8 || y0 + (h as i32) < dy + 4;
        assert_eq!(said.contains("black"), holes, "{said}");
    }
    let mut outside = layer([3, 2], None, &["R", "G", "B"], rgb);
    outside.attributes.layer_position = Vec2(8, 0);
    write_layers(&path, vec![outside], |all| all.display_window = IntegerBounds::new(Vec2(0, 0), Vec2(width, height)));
    assert!(crate::read(&path).unwrap_err().to_string().contains("outside of its display window"));
}

#[test]
fn layers_by_their_names() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.exr");
    let write = |channels: &[&str]| {
        write_layers(&path, vec![layer([4, 2], None, channels, |c, _, _| c as f32)], |_| {});
    };
    let red = |layer: Option<&str>| read_light(&path, layer).map(|light| (light.rgb[0], light.notes.join("; ")));
    let refused = |layer: Option<&str>| red(layer).unwrap_err().to_string();
    // The only picture besides other channels, which are in alphabetic order.
    write(&[
        "ViewLayer.Combined.A",
        "ViewLayer.Combined.B",
        "ViewLayer.Combined.G",
        "ViewLayer.Combined.R",
        "ViewLayer.Depth.Z",
    ]);
    assert_eq!(red(None).unwrap(), ([3.0, 2.0, 1.0], String::new()));
    assert_eq!(red(Some("ViewLayer.Combined")).unwrap().0, [3.0, 2.0, 1.0]);
    assert!(refused(Some("Depth")).contains("\"ViewLayer.Combined\""));
    write(&["B", "G", "R", "Z", "normal.X", "normal.Y", "normal.Z"]);
    assert_eq!(red(None).unwrap(), ([2.0, 1.0, 0.0], String::new()));
    write(&["b", "g", "r"]);
    assert_eq!(red(None).unwrap().0, [2.0, 1.0, 0.0]);
    // The default view beside another one.
    write(&["B", "G", "R", "right.B", "right.G", "right.R"]);
    let (pixel, said) = red(None).unwrap();
    assert!(pixel == [2.0, 1.0, 0.0] && said.contains("not \"right\""), "{pixel:?} {said}");
    assert_eq!(red(Some("right")).unwrap(), ([5.0, 4.0, 3.0], String::new()));
    assert_eq!(red(Some("")).unwrap().0, [2.0, 1.0, 0.0]);
    // Passes with and without one complete picture.
    write(&["L.Combined.B", "L.Combined.G", "L.Combined.R", "L.Diffuse.B", "L.Diffuse.G", "L.Diffuse.R"]);
    assert!(red(None).unwrap().1.contains("\"L.Combined\"; not \"L.Diffuse\""));
    write(&["left.B", "left.G", "left.R", "right.B", "right.G", "right.R"]);
    assert!(refused(None).contains("2 pictures: \"left\", \"right\""), "{}", refused(None));
    assert_eq!(red(Some("LEFT")).unwrap().0, [2.0, 1.0, 0.0]);
    let photograph = crate::read(&path).unwrap_err().to_string();
    assert!(photograph.contains("2 pictures") && photograph.contains("export the layer"), "{photograph}");
    write(&["normal.X", "normal.Y", "normal.Z"]);
    assert!(refused(None).contains("normal.X, normal.Y, normal.Z; a picture has R, G and B"));
    write(&["mist"]);
    assert_eq!(red(None).unwrap().0, [0.0; 3]);
}

#[test]
fn parts_by_their_names() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.exr");
    let part = |name: &str, channels: &[&str], v: f32| layer([4, 2], Some(name), channels, move |_, _, _| v);
    write_layers(&path, vec![part("depth", &["Z"], 1.0), part("colour", &["B", "G", "R"], 2.0)], |_| {});
    assert_eq!(read_light(&path, None).unwrap().rgb[7], [2.0; 3]);
    let both = vec![part("day", &["B", "G", "R"], 3.0), part("night", &["B", "G", "R"], 4.0), part("fog", &["Y"], 5.0)];
    write_layers(&path, both, |_| {});
    assert!(read_light(&path, None).unwrap_err().to_string().contains("3 pictures: \"day\", \"night\", \"fog\""));
    assert_eq!(read_light(&path, Some("night")).unwrap().rgb[0], [4.0; 3]);
    assert_eq!(read_light(&path, Some("fog")).unwrap().rgb[0], [5.0; 3]);
    // The view distinguishes parts of the same name.
    let mut views = vec![part("a", &["B", "G", "R"], 6.0), part("b", &["B", "G", "R"], 7.0)];
    for (part, view) in views.iter_mut().zip(["left", "right"]) {
        part.attributes.view_name = Some(view.into());
    }
    write_layers(&path, views, |_| {});
    assert_eq!(read_light(&path, Some("b")).unwrap().rgb[0], [7.0; 3]);
}

#[test]
fn primaries_and_cubes() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.exr");
    let chroma = |[r, g, b, w]: [[f32; 2]; 4]| {
        let at = |[x, y]: [f32; 2]| Vec2(x, y);
        Chromaticities { red: at(r), green: at(g), blue: at(b), white: at(w) }
    };
    let p3 = chroma([[0.680, 0.320], [0.265, 0.690], [0.150, 0.060], [0.3127, 0.3290]]);
    let write = |pixel: [f32; 3], chromaticities: Option<Chromaticities>| {
        let one = layer([2, 1], None, &["R", "G", "B"], move |c, _, _| pixel[c]);
        write_layers(&path, vec![one], move |all| all.chromaticities = chromaticities);
    };
    // By the matrix from P3 D65 to sRGB of CSS Color 4; colours outside of sRGB are clipped.
    for (pixel, expected) in [
        ([1.0, 0.0, 0.0], [1.2249, 0.0, 0.0]),
        ([0.0, 1.0, 0.0], [0.0, 1.0419, 0.0]),
        ([2.0, 2.0, 2.0], [2.0, 2.0, 2.0]),
        ([3.0, 2.0, 1.0], [3.2248, 1.9580, 0.8815]),
    ] {
        write(pixel, Some(p3));
        let light = read_light(&path, None).unwrap();
        assert!(light.rgb[0].iter().zip(expected).all(|(a, b)| (a - b).abs() < 2e-3), "{:?}", light.rgb[0]);
        assert!(light.notes.join("").contains("P3 D65"), "{:?}", light.notes);
        // Photographs keep the channels of the camera.
        assert_eq!(crate::read(&path).unwrap().samples, Samples::F32([pixel, pixel].concat()));
    }
    let rec709 = chroma([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06], [0.3127, 0.3290]]);
    for same in [None, Some(rec709)] {
        write([1.0, 2.0, 3.0], same);
        let light = read_light(&path, None).unwrap();
        assert_eq!((light.rgb[0], light.notes.len()), ([1.0, 2.0, 3.0], 0));
    }
    // An unknown compression is not damage.
    let whole = fs::read(&path).unwrap();
    let at = whole.windows(23).position(|w| w == b"compression\0compression").unwrap() + 28;
    let mut newer = whole.clone();
    newer[at] = 13;
    fs::write(&path, newer).unwrap();
    let said = [crate::read(&path).map(drop), size(&path).map(drop), read_exr(&path).map(drop)];
    assert!(said.iter().all(|s| s.as_ref().unwrap_err().to_string().contains("compression number 13")), "{said:?}");
    // Without chromaticities, the name of the colour space applies.
    for (space, pixel, words) in
        [("lin_rec2020_scene", [1.0, 1.0, 1.0], "from Rec. 2020"), ("sRGB", [1.0; 3], "read as linear")]
    {
        let mut one = layer([2, 1], None, &["R", "G", "B"], move |c, _, _| pixel[c]);
        one.attributes.other.insert("oiio:ColorSpace".into(), AttributeValue::Text(space.into()));
        write_layers(&path, vec![one], |_| {});
        let light = read_light(&path, None).unwrap();
        assert!(light.rgb[0].iter().all(|v| (v - 1.0).abs() < 1e-5), "{:?}", light.rgb);
        assert!(light.notes.join("").contains(words), "{:?}", light.notes);
    }
    // An infinite pixel stays infinite.
    write([f32::INFINITY; 3], Some(p3));
    assert_eq!(read_light(&path, None).unwrap().rgb[0], [f32::INFINITY; 3]);
    write([1.0; 3], Some(chroma([[0.1, 0.1], [0.2, 0.2], [0.3, 0.3], [0.3, 0.3]])));
    assert!(read_light(&path, None).unwrap_err().to_string().contains("lie on a line"));
    let mut cube = layer([2, 12], None, &["R", "G", "B"], rgb);
    cube.attributes.environment_map = Some(EnvironmentMap::Cube);
    write_layers(&path, vec![cube], |_| {});
    assert!(read_light(&path, None).unwrap_err().to_string().contains("faces of a cube"));
    let png = png_file(dir.path(), ::image::ExtendedColorType::Rgb8, &bytes(3));
    assert!(read_light(&png, None).unwrap_err().to_string().contains("is not linear radiance"));
}

/// Tiles with mip maps: the full resolution is read.
#[test]
fn mip_maps() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.exr");
    let levels = |c: usize| {
        let level = |n: usize, v: f32| FlatSamples::F32(vec![v + c as f32; n * n]);
        let level_data = vec![level(8, 10.0), level(4, 20.0), level(2, 30.0), level(1, 40.0)];
        Levels::Mip { rounding_mode: exr::math::RoundingMode::Down, level_data }
    };
    let channels = ["B", "G", "R"].iter().enumerate().map(|(c, name)| AnyChannel::new(*name, levels(c))).collect();
    let encoding = Encoding { blocks: Blocks::Tiles(Vec2(4, 4)), ..Encoding::FAST_LOSSLESS };
    let layer = Layer::new((8, 8), LayerAttributes::default(), encoding, AnyChannels::sort(channels));
    Image::from_layer(layer).write().to_file(&path).unwrap();
    assert_eq!(read_light(&path, None).unwrap().rgb, [[12.0, 11.0, 10.0]; 64]);
}

/// Uncompressed file of Y at all pixels and RY, BY at every second one.
pub(super) fn luminance_chroma(size: [usize; 2], at: [i32; 2], compression: u8) -> Vec<u8> {
    let [width, height] = size;
    let attribute = |name: &str, kind: &str, value: &[u8]| {
        [name.as_bytes(), b"\0", kind.as_bytes(), b"\0", &(value.len() as u32).to_le_bytes(), value].concat()
    };
    let ints = |values: &[i32]| -> Vec<u8> { values.iter().flat_map(|v| v.to_le_bytes()).collect() };
    let floats = |values: &[f32]| -> Vec<u8> { values.iter().flat_map(|v| v.to_le_bytes()).collect() };
    let channel = |name: &str, sampling: i32| [name.as_bytes(), b"\0", &ints(&[1, 0, sampling, sampling])].concat();
    let channels = [channel("BY", 2), channel("RY", 2), channel("Y", 1), vec![0]].concat();
    let window = ints(&[at[0], at[1], at[0] + width as i32 - 1, at[1] + height as i32 - 1]);
    let mut file = [
        vec![0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0],
        attribute("channels", "chlist", &channels),
        attribute("compression", "compression", &[compression]),
        attribute("dataWindow", "box2i", &window),
        attribute("displayWindow", "box2i", &window),
        attribute("lineOrder", "lineOrder", &[0]),
        attribute("pixelAspectRatio", "float", &floats(&[1.0])),
        attribute("screenWindowCenter", "v2f", &floats(&[0.0, 0.0])),
        attribute("screenWindowWidth", "float", &floats(&[1.0])),
        vec![0],
    ]
    .concat();
    let table = file.len();
    file.resize(table + 8 * height, 0);
    for y in 0..height {
        let place = (file.len() as u64).to_le_bytes();
        file[table + 8 * y..table + 8 * y + 8].copy_from_slice(&place);
        let mut row: Vec<u8> = vec![];
        let mut put = |v: f32| row.extend(f16::from_f32(v).to_le_bytes());
        if y % 2 == 0 {
            (0..width / 2).for_each(|_| put(-0.5));
            (0..width / 2).for_each(|x| put(0.25 * x as f32));
        }
        (0..width).for_each(|x| put((x + 1) as f32));
        file.extend(ints(&[at[1] + y as i32, row.len() as i32]));
        file.extend(row);
    }
    file
}

#[test]
fn luminance_and_chroma_become_red_green_and_blue() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.exr");
    for at in [[0, 0], [-4, 6]] {
        fs::write(&path, luminance_chroma([8, 4], at, 0)).unwrap();
        assert_eq!(info(&path).unwrap(), Info { width: 8, height: 4, channels: 3, depth: Depth::F32 });
        let light = read_light(&path, None).unwrap();
        for (k, [r, g, b]) in light.rgb.iter().enumerate() {
            let (x, y) = ((k % 8) as f32, (k % 8 + 1) as f32);
            // (R - Y)/Y increases by 1/8 per pixel up to the last sample; (B - Y)/Y is -1/2.
            let red = y * (1.0 + 0.125 * x.min(6.0));
            assert!((r - red).abs() < 1e-5 && (b - 0.5 * y).abs() < 1e-5, "{k}: {r} {red}");
            assert!((0.2126 * r + 0.7152 * g + 0.0722 * b - y).abs() < 1e-3 * y);
        }
    }
    let said = read_exr(&path).unwrap_err().to_string();
    assert!(said.contains("subsampled channels"), "{said}");
    // Tiles and DWA are refused by name; odd positions and truncated files are damage.
    fs::write(&path, luminance_chroma([8, 4], [0, 0], 8)).unwrap();
    let said = read_light(&path, None).unwrap_err().to_string();
    assert!(said.contains("subsampled channels with dwaa"), "{said}");
    fs::write(&path, luminance_chroma([8, 4], [1, 0], 0)).unwrap();
    assert!(read_light(&path, None).unwrap_err().to_string().contains("does not divide"));
    let whole = luminance_chroma([8, 4], [0, 0], 0);
    for length in 300..whole.len() {
        fs::write(&path, &whole[..length]).unwrap();
        assert!(crate::read(&path).is_err(), "{length} of {}", whole.len());
    }
}

/// Files that `tests/openexr/run` writes with the OpenEXR library, compared with the samples that the library reads.
#[test]
fn matrix_of_the_openexr_library() {
    let Some(folder) = std::env::var_os("NACRE_EXR_MATRIX") else {
        println!("skipped: no NACRE_EXR_MATRIX (tests/openexr/run sets it)");
        return;
    };
    let mut files: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|e| e == "exr"));
    files.sort();
    assert!(files.len() > 100, "{} files", files.len());
    let (mut outcomes, mut wrong) = (std::collections::BTreeMap::<(String, String), usize>::new(), vec![]);
    for path in files {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let compression = name.split('-').next().unwrap().to_owned();
        let truth = fs::read(path.with_extension("f32")).unwrap();
        let truth: Vec<f32> = truth.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        let outcome = match crate::read(&path) {
            Ok(Raster { samples: Samples::F32(found), .. }) => {
                let difference = |(a, b): (&f32, &f32)| (a - b).abs() / b.abs().max(1e-3);
                let most = found.iter().zip(&truth).map(difference).fold(0.0, f32::max);
                if found.len() != truth.len() || most > 0.0 {
                    wrong.push(format!("{name}: off by {most}"));
                }
                "equal to the bit".into()
            }
            Ok(_) => "no floats".into(),
            Err(error) => {
                let words = error.to_string();
                if words.contains("damaged") {
                    wrong.push(words.clone());
                }
                words.split(": ").skip(1).collect::<Vec<_>>().join(": ")
            }
        };
        *outcomes.entry((compression, outcome)).or_default() += 1;
    }
    outcomes.iter().for_each(|((compression, outcome), count)| println!("{compression}: {count} files {outcome}"));
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Selected rows equal those of the whole map, whatever the compression and the data window.
#[test]
fn selected_rows() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.exr");
    let put = |path: &Path, name: &str, wanted: &(dyn Fn(usize) -> bool + Sync)| {
        let mut rows = std::collections::BTreeMap::<usize, Vec<f32>>::new();
        let size = read_exr_rows(path, name, wanted, |row, column, values| {
            let known = rows.entry(row).or_default();
            assert_eq!(known.len(), column);
            known.extend(values);
        });
        (size, rows)
    };
    for encoding in [Encoding::FAST_LOSSLESS, Encoding::UNCOMPRESSED, Encoding::SMALL_LOSSLESS] {
        let mut inner = layer([5, 70], None, &["a", "b"], rgb);
        inner.encoding = encoding;
        write_layers(&path, vec![inner], |_| ());
        let header = read_exr_header(&path).unwrap();
        assert_eq!((header.width, header.height, header.channels.as_slice()), (5, 70, &["a".into(), "b".into()][..]));
        let whole = read_exr(&path).unwrap();
        let (size, rows) = put(&path, "b", &|row| row % 33 == 1);
        assert_eq!(size.unwrap(), Some([5, 70]));
        assert_eq!(rows.keys().copied().collect::<Vec<_>>(), [1, 34, 67]);
        for (row, values) in rows {
            assert_eq!(values, whole.channels["b"][5 * row..][..5], "{row}");
        }
        assert_eq!(put(&path, "c", &|_| true).0.unwrap(), None);
    }
    // A data window that begins above the picture and ends within it.
    let mut inner = layer([5, 6], None, &["a"], rgb);
    inner.attributes.layer_position = Vec2(0, -2);
    write_layers(&path, vec![inner], |all| all.display_window = IntegerBounds::new(Vec2(0, 0), Vec2(5, 8)));
    let (size, rows) = put(&path, "a", &|row| row > 2);
    assert_eq!(
        (size.unwrap(), rows.into_iter().collect::<Vec<_>>()),
        (Some([5, 8]), vec![(3, vec![51.0, 52.0, 53.0, 54.0, 55.0])])
    );
    // A file that ends within a selected row is refused; rows before it are still read.
    write_exr(&path, 400, 40, &["a"], &[], &|_, y, row| row.fill(y as f32)).unwrap();
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() - 800]).unwrap();
    assert_eq!(put(&path, "a", &|row| row == 3).1[&3], vec![3.0; 400]);
    assert!(put(&path, "a", &|row| row == 39).0.is_err());
}
