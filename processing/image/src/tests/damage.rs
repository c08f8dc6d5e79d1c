//! Truncated, damaged, gigantic and absent files.

use tempfile::TempDir;

use super::*;

/// One small file of each kind.
fn samples(dir: &TempDir) -> Vec<PathBuf> {
    use ::image::ExtendedColorType as C;
    let d = dir.path();
    let exr = d.join("own.exr");
    exr_file(&exr, &["R", "G", "B"]);
    let zip = d.join("zip.exr");
    exr::prelude::write_rgb_file(&zip, W, H, |x, y| (x as f32, y as f32, 0.5_f32)).unwrap();
    let chroma = d.join("chroma.exr");
    fs::write(&chroma, exr_files::luminance_chroma([8, 4], [0, 0], 0)).unwrap();
    let hdr = d.join("runs.hdr");
    fs::write(&hdr, hdr_files::with_runs()).unwrap();
    let deflate = Compression::Deflate(Default::default());
    let stating = details::samples(d);
    let mut all = vec![
        png_file(d, C::Rgb8, &bytes(3)),
        png_file(d, C::L16, &words(1).iter().flat_map(|w| w.to_ne_bytes()).collect::<Vec<_>>()),
        tiff_file::<colortype::Gray16>(d, "plain.tif", Compression::Uncompressed, &words(1)),
        tiff_file::<colortype::RGB8>(d, "lzw.tif", Compression::Lzw, &bytes(3)),
        tiff_file::<colortype::Gray32Float>(d, "deflate.tif", deflate, &floats(1)),
        jpeg_file(d, false),
        jpeg_file(d, true),
        exr,
        zip,
        named(d, "x.fits", &arrays::fits(16, &[5, 4], &["BZERO   = 32768"], &[77; 40])),
        named(d, "x.npy", &arrays::npy("<f2", true, "(3, 2, 3)", &[60; 36])),
        webp_file(d),
        named(d, "x.dng", &camera::small()),
        chroma,
        hdr,
    ];
    all.extend(stating);
    all
}

/// Some files of other programs, if `tests/formats/run` has written them.
fn of_other_programs() -> Vec<PathBuf> {
    let Some(folder) = std::env::var_os("NACRE_FORMATS_MATRIX").map(PathBuf::from) else { return vec![] };
    let index = fs::read_to_string(folder.join("index.tsv")).unwrap();
    let names = index.lines().filter_map(|line| line.split('\t').next());
    names.step_by(97).map(|name| folder.join(name)).collect()
}

fn named(dir: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = dir.join(name);
    fs::write(&path, bytes).unwrap();
    path
}

fn webp_file(dir: &Path) -> PathBuf {
    let path = dir.join("x.webp");
    let encoder = image_webp::WebPEncoder::new(fs::File::create(&path).unwrap());
    encoder.encode(&bytes(3), W as u32, H as u32, image_webp::ColorType::Rgb8).unwrap();
    path
}

#[test]
fn truncated_files_are_errors_or_whole() {
    let dir = tempfile::tempdir().unwrap();
    let cut = dir.path().join("cut");
    for path in samples(&dir) {
        let file = fs::read(&path).unwrap();
        // A build without the feature `raw` refuses the DNG.
        let whole = read(&path).ok();
        let step = if file.len() < 2000 { 1 } else { 7 };
        for length in (0..file.len()).step_by(step) {
            fs::write(&cut, &file[..length]).unwrap();
            _ = info(&cut);
            _ = exposure(&cut);
            _ = read_exr(&cut);
            _ = read_light(&cut, None);
            if let Ok(raster) = read(&cut) {
                assert!(Some(raster) == whole, "{} cut to {length} of {} bytes", path.display(), file.len());
            }
        }
    }
}

#[test]
fn damaged_files_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    let bad = dir.path().join("bad");
    let rounds = std::env::var("NACRE_FUZZ_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(400);
    for (seed, path) in samples(&dir).into_iter().chain(of_other_programs()).enumerate() {
        let file = fs::read(&path).unwrap();
        let mut dice = Dice(seed as u64 + 77);
        for round in 0..rounds {
            let mut copy = file.clone();
            // Half of the changes are in the first 400 bytes, where headers are.
            let reach = if round % 2 == 0 { copy.len() } else { copy.len().min(400) };
            for _ in 0..=dice.roll() % 4 {
                let at = dice.roll() as usize % reach;
                copy[at] = if dice.roll().is_multiple_of(3) { 0xff } else { dice.roll() as u8 };
            }
            fs::write(&bad, &copy).unwrap();
            let outcome = std::panic::catch_unwind(|| {
                _ = info(&bad);
                _ = exposure(&bad);
                _ = read_exr(&bad);
                _ = levels(&bad);
                _ = read_light(&bad, None);
                _ = read(&bad);
            });
            if outcome.is_err() {
                let kept = std::env::temp_dir().join(format!("nacre-panic-{seed}-{round}"));
                fs::copy(&bad, &kept).unwrap();
                panic!("panic on a damaged {}: see {}", path.display(), kept.display());
            }
        }
    }
}

#[test]
fn gigantic_headers_are_refused_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("huge");
    let exr = dir.path().join("x.exr");
    exr_file(&exr, &["Y"]);
    let mut exr = fs::read(&exr).unwrap();
    let window = exr.windows(6).position(|w| w == b"box2i\0").unwrap() + 6 + 4;
    for side in [window + 8, window + 12] {
        exr[side..side + 4].copy_from_slice(&59_999_u32.to_le_bytes());
    }
    let tiff = tiff_file::<colortype::Gray16>(dir.path(), "x.tif", Compression::Uncompressed, &words(1));
    let mut tiff = fs::read(tiff).unwrap();
    let mut tiff_patched = 0;
    // Width, height and rows per strip, so that there is still one strip.
    for tag in [256_u16, 257, 278] {
        let entry = [&tag.to_le_bytes()[..], &4_u16.to_le_bytes(), &1_u32.to_le_bytes()].concat();
        if let Some(at) = tiff.windows(8).position(|w| w == entry) {
            tiff[at + 8..at + 12].copy_from_slice(&60_000_u32.to_le_bytes());
            tiff_patched += 1;
        }
    }
    assert_eq!(tiff_patched, 3);
    let huge_png = |w, h| raw_png(&[(b"IHDR", &png_header(w, h, 16, 6)), (b"IDAT", &[]), (b"IEND", &[])]);
    for file in [huge_png(60_000, 60_000), huge_png(2_000_000, 2), huge_png(16_384, 16_384), tiff, exr] {
        fs::write(&path, &file).unwrap();
        for error in [info(&path).unwrap_err().to_string(), read(&path).unwrap_err().to_string()] {
            assert!(error.contains("more than") && error.contains("pixel"), "{error}");
        }
    }
}

/// 128 Mpixel is the largest size.
#[test]
fn the_largest_image_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.png");
    let header = |w, h| raw_png(&[(b"IHDR", &png_header(w, h, 8, 0)), (b"IDAT", &[]), (b"IEND", &[])]);
    fs::write(&path, header(8192, 16_384)).unwrap();
    assert_eq!((info(&path).unwrap().width, size(&path).unwrap()), (8192, [8192, 16_384]));
    fs::write(&path, header(8192, 16_385)).unwrap();
    let errors = [info(&path).unwrap_err(), read(&path).unwrap_err(), size(&path).unwrap_err()];
    assert!(errors.iter().all(|e| e.to_string().contains("more than 128 Mpixel")), "{errors:?}");
}

#[test]
fn the_size_of_maps_of_any_channels_is_known() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("map.exr");
    exr_file(&path, &["period", "sigma", "mask", "light"]);
    assert!(info(&path).is_err());
    assert_eq!(size(&path).unwrap(), [W, H]);
}

/// The decoder of B44 overflows on a block of zeros in builds with overflow checks, in a thread of the decoder.
#[cfg(debug_assertions)]
#[test]
fn a_panic_in_a_thread_of_a_decoder_is_an_error_of_the_file() {
    use exr::prelude::*;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("b44.exr");
    let channels =
        SpecificChannels::rgb(|p: Vec2<usize>| [p.0, p.1, p.0 + p.1].map(|v| f16::from_f32(v as f32)).into());
    let encoding = Encoding { compression: Compression::B44, ..Encoding::UNCOMPRESSED };
    Image::from_layer(Layer::new((4, 4), LayerAttributes::default(), encoding, channels))
        .write()
        .to_file(&path)
        .unwrap();
    let mut file = fs::read(&path).unwrap();
    // Three channels of one block of 14 bytes.
    let blocks = file.len() - 3 * 14;
    file[blocks..].fill(0);
    fs::write(&path, file).unwrap();
    let errors = [super::read(&path).map(drop), read_exr(&path).map(drop)];
    assert!(
        errors.iter().all(|e| e.as_ref().unwrap_err().to_string().contains("b44.exr: is truncated or damaged")),
        "{errors:?}"
    );
}

/// A palette that ends within a colour makes the decoder of PNG panic.
#[test]
fn a_panic_of_a_decoder_is_an_error_of_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("palette.png");
    // Stored zlib block with filter byte 0 and three pixels 0, and its Adler-32.
    let row = [0x78, 1, 1, 4, 0, 0xfb, 0xff, 0, 0, 0, 0, 0, 4, 0, 1];
    let chunks: [(&[u8; 4], &[u8]); 4] =
        [(b"IHDR", &png_header(3, 1, 8, 3)), (b"PLTE", &[1, 2, 3, 4]), (b"IDAT", &row), (b"IEND", &[])];
    fs::write(&path, raw_png(&chunks)).unwrap();
    let said = read(&path).unwrap_err().to_string();
    assert!(said.contains("palette.png: makes its decoder fail (") && said.contains("; copy or export"), "{said}");
}

#[test]
fn what_is_no_image_says_so() {
    let dir = tempfile::tempdir().unwrap();
    let says = |path: &Path, words: &str| {
        for error in [info(path).unwrap_err().to_string(), read(path).unwrap_err().to_string()] {
            assert!(error.contains(words), "{error}");
        }
    };
    let path = dir.path().join("x.png");
    says(&path, "does not exist");
    says(dir.path(), "is a folder");
    says(Path::new("/dev/null"), "is a device, not a regular file");
    fs::write(&path, b"").unwrap();
    says(&path, "is empty");
    fs::write(&path, b"hello, this is text").unwrap();
    says(&path, "is not a PNG, JPEG, TIFF, BMP, WebP, EXR, Radiance HDR, FITS, NPY or camera raw image");
    fs::write(&path, b"\x89PNG\r\n\x1a\n").unwrap();
    says(&path, "truncated or damaged");
}
