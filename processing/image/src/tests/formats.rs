//! Round trips of every format and depth.

use super::*;

#[test]
fn png_of_every_kind() {
    use ::image::ExtendedColorType as C;
    let dir = tempfile::tempdir().unwrap();
    for (color, stored, channels) in [(C::L8, 1, 1), (C::La8, 2, 1), (C::Rgb8, 3, 3), (C::Rgba8, 4, 3)] {
        let data = bytes(stored);
        let path = png_file(dir.path(), color, &data);
        check(&path, channels, Depth::U8, Samples::U8(kept(&data, stored, channels)));
    }
    for (color, stored, channels) in [(C::L16, 1, 1), (C::La16, 2, 1), (C::Rgb16, 3, 3), (C::Rgba16, 4, 3)] {
        let data = words(stored);
        let native: Vec<u8> = data.iter().flat_map(|w| w.to_ne_bytes()).collect();
        let path = png_file(dir.path(), color, &native);
        check(&path, channels, Depth::U16, Samples::U16(kept(&data, stored, channels)));
    }
    let path = dir.path().join("own");
    write_png8(&path, W, H, 3, &bytes(3)).unwrap();
    check(&path, 3, Depth::U8, Samples::U8(bytes(3)));
    write_png8(&path, W, H, 1, &bytes(1)).unwrap();
    check(&path, 1, Depth::U8, Samples::U8(bytes(1)));
    write_png16_gray(&path, W, H, &words(1)).unwrap();
    check(&path, 1, Depth::U16, Samples::U16(words(1)));
    assert!(write_png8(&path, W, H, 3, &bytes(1)).is_err());
}

#[test]
fn png_of_one_bit_and_of_a_palette() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.png");
    // Stored zlib block with filter byte 0 and the bits 1010 0000, and its Adler-32.
    let idat = |row: u8| {
        let adler = (u32::from(row) + 2) << 16 | (u32::from(row) + 1);
        [&[0x78, 1, 1, 2, 0, 0xfd, 0xff, 0, row][..], &adler.to_be_bytes()].concat()
    };
    fs::write(&path, raw_png(&[(b"IHDR", &png_header(3, 1, 1, 0)), (b"IDAT", &idat(0xa0)), (b"IEND", &[])])).unwrap();
    assert_eq!(read(&path).unwrap().samples, Samples::U8(vec![255, 0, 255]));
    let palette = [1, 2, 3, 4, 5, 6];
    let chunks: [(&[u8; 4], &[u8]); 4] =
        [(b"IHDR", &png_header(3, 1, 1, 3)), (b"PLTE", &palette), (b"IDAT", &idat(0xa0)), (b"IEND", &[])];
    fs::write(&path, raw_png(&chunks)).unwrap();
    assert_eq!(read(&path).unwrap().samples, Samples::U8(vec![4, 5, 6, 1, 2, 3, 4, 5, 6]));
}

#[test]
fn tiff_of_every_kind() {
    use colortype as C;
    let dir = tempfile::tempdir().unwrap();
    let d = dir.path();
    let deflate = Compression::Deflate(Default::default());
    for c in [Compression::Uncompressed, Compression::Lzw, deflate, Compression::Packbits] {
        check(&tiff_file::<C::Gray8>(d, "a", c, &bytes(1)), 1, Depth::U8, Samples::U8(bytes(1)));
        check(&tiff_file::<C::RGB8>(d, "b", c, &bytes(3)), 3, Depth::U8, Samples::U8(bytes(3)));
        check(&tiff_file::<C::Gray16>(d, "c", c, &words(1)), 1, Depth::U16, Samples::U16(words(1)));
        check(&tiff_file::<C::RGB16>(d, "d", c, &words(3)), 3, Depth::U16, Samples::U16(words(3)));
        check(&tiff_file::<C::Gray32Float>(d, "e", c, &floats(1)), 1, Depth::F32, Samples::F32(floats(1)));
        check(&tiff_file::<C::RGB32Float>(d, "f", c, &floats(3)), 3, Depth::F32, Samples::F32(floats(3)));
    }
    let c = Compression::Uncompressed;
    let rgba = tiff_file::<C::RGBA8>(d, "g", c, &bytes(4));
    check(&rgba, 3, Depth::U8, Samples::U8(kept(&bytes(4), 4, 3)));
    let double: Vec<f64> = floats(1).into_iter().map(f64::from).collect();
    check(&tiff_file::<C::Gray64Float>(d, "h", c, &double), 1, Depth::F32, Samples::F32(floats(1)));
    let wide: Vec<u32> = words(1).into_iter().map(u32::from).collect();
    let wide = tiff_file::<C::Gray32>(d, "i", c, &wide);
    for error in [info(&wide).unwrap_err(), read(&wide).unwrap_err()] {
        assert!(error.to_string().contains("32-bit unsigned integers; save it as a TIFF of 32-bit floats"), "{error}");
    }
    let cmyk = read(&tiff_file::<C::CMYK8>(d, "j", c, &bytes(4))).unwrap_err().to_string();
    assert!(cmyk.contains("CMYK"), "{cmyk}");
}

#[test]
fn jpeg_grey_and_rgb() {
    let dir = tempfile::tempdir().unwrap();
    for (rgb, channels) in [(false, 1), (true, 3)] {
        let path = jpeg_file(dir.path(), rgb);
        let expected = ::image::open(&path).unwrap().into_bytes();
        let raster = read(&path).unwrap();
        assert_eq!(raster.samples, Samples::U8(expected));
        assert_eq!((raster.width, raster.height, raster.channels), (W * 5, H * 5, channels));
        assert_eq!(info(&path).unwrap(), Info { width: W * 5, height: H * 5, channels, depth: Depth::U8 });
    }
}

#[test]
fn jpeg_cut_short_or_cmyk_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let whole = fs::read(jpeg_file(dir.path(), true)).unwrap();
    let path = dir.path().join("cut.jpg");
    // A thumbnail's end marker inside an APP1 segment, and a file truncated within its own data.
    let mut cut = vec![0xff, 0xd8, 0xff, 0xe1, 0, 6, 0xff, 0xd9, 0xff, 0xd9];
    cut.extend(&whole[2..whole.len() - 60]);
    fs::write(&path, &cut).unwrap();
    let error = read(&path).unwrap_err().to_string();
    assert!(error.contains("truncated"), "{error}");
    let frame = whole.windows(2).position(|m| m == [0xff, 0xc0]).unwrap();
    let mut cmyk = whole.clone();
    cmyk[frame + 9] = 4;
    fs::write(&path, &cmyk).unwrap();
    let error = info(&path).unwrap_err().to_string();
    assert!(error.contains("CMYK"), "{error}");
}

#[test]
fn exr_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.exr");
    let rgba = exr_file(&path, &["R", "G", "B", "A"]);
    check(&path, 3, Depth::F32, Samples::F32(kept(&rgba, 4, 3)));
    let grey = exr_file(&path, &["anything"]);
    check(&path, 1, Depth::F32, Samples::F32(grey));
    let grey = exr_file(&path, &["Y", "A"]);
    check(&path, 1, Depth::F32, Samples::F32(kept(&grey, 2, 1)));
    exr_file(&path, &["depth", "normal"]);
    for error in [info(&path).unwrap_err().to_string(), read(&path).unwrap_err().to_string()] {
        assert!(error.contains("depth, normal"), "{error}");
    }
}

#[test]
fn exr_of_other_programs() {
    use exr::prelude::*;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.exr");
    let data = floats(1);
    let pixel = |p: Vec2<usize>| {
        let v = f16::from_f32(data[p.1 * W + p.0]);
        (v, f16::from_f32(2.0), 3_u32)
    };
    for compression in [Compression::ZIP16, Compression::PIZ, Compression::RLE] {
        let channels = SpecificChannels::rgb(pixel);
        let encoding = Encoding { compression, ..Encoding::FAST_LOSSLESS };
        let layer = Layer::new((W, H), LayerAttributes::default(), encoding, channels);
        Image::from_layer(layer).write().to_file(&path).unwrap();
        let expected = data.iter().flat_map(|v| [f16::from_f32(*v).to_f32(), 2.0, 3.0]).collect();
        check(&path, 3, Depth::F32, Samples::F32(expected));
    }
}

#[test]
fn exr_map_keeps_nan_names_and_attributes() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("map.exr");
    let value = |c: usize, row: usize, x: usize| match x {
        3 => f32::NAN,
        4 => f32::NEG_INFINITY,
        _ => (c * 10_000 + row * 100 + x) as f32,
    };
    let names = ["theta", "Amplitude", "a name that is longer than thirty-one characters"];
    let attributes = [("pixelPitch_um", Attribute::Number(3.45)), ("units", Attribute::Text("rad, µm".into()))];
    let (width, height) = (50, 3000);
    let fill = |c: usize, row: usize, out: &mut [f32]| {
        out.iter_mut().enumerate().for_each(|(x, v)| *v = value(c, row, x));
    };
    let write = || write_exr(&path, width, height, &names, &attributes, &fill).unwrap();
    write();
    let map = read_exr(&path).unwrap();
    assert_eq!((map.width, map.height, map.channels.len()), (width, height, 3));
    for (c, name) in names.iter().enumerate() {
        for (i, stored) in map.channels[*name].iter().enumerate() {
            assert_eq!(stored.to_bits(), value(c, i / width, i % width).to_bits());
        }
    }
    assert_eq!(map.attributes["pixelPitch_um"], "3.45");
    assert_eq!(map.attributes["units"], "rad, µm");
    // The exr crate's strict reader accepts the file, and equal maps give equal bytes.
    let strict = exr::meta::MetaData::read_from_file(&path, true).unwrap();
    assert_eq!(strict.headers.len(), 1);
    let first = fs::read(&path).unwrap();
    write();
    assert!(first == fs::read(&path).unwrap());
    for bad in [&["a", "a"][..], &[], &[""]] {
        assert!(write_exr(&path, 2, 2, bad, &[], &fill).is_err());
    }
}

#[test]
fn system_errors_keep_their_kind() {
    let full = Path::new("/dev/full");
    if !full.exists() {
        println!("skipped: no /dev/full");
        return;
    }
    for error in [write_png8(full, W, H, 1, &bytes(1)), write_exr(full, W, H, &["Y"], &[], &|_, _, _| {})] {
        assert!(error.unwrap_err().to_string().contains("free some space"));
    }
    let error = write_png16_gray(full, W, H, &words(1)).unwrap_err().to_string();
    assert!(error.contains("/dev/full: is a device"), "{error}");
}
