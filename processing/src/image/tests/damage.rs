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
    let deflate = Compression::Deflate(Default::default());
    vec![
        png_file(d, C::Rgb8, &bytes(3)),
        png_file(d, C::L16, &words(1).iter().flat_map(|w| w.to_ne_bytes()).collect::<Vec<_>>()),
        tiff_file::<colortype::Gray16>(d, "plain.tif", Compression::Uncompressed, &words(1)),
        tiff_file::<colortype::RGB8>(d, "lzw.tif", Compression::Lzw, &bytes(3)),
        tiff_file::<colortype::Gray32Float>(d, "deflate.tif", deflate, &floats(1)),
        jpeg_file(d, false),
        jpeg_file(d, true),
        exr,
        zip,
    ]
}

#[test]
fn truncated_files_are_errors_or_whole() {
    let dir = tempfile::tempdir().unwrap();
    let cut = dir.path().join("cut");
    for path in samples(&dir) {
        let file = fs::read(&path).unwrap();
        let whole = read(&path).unwrap();
        let step = if file.len() < 2000 { 1 } else { 7 };
        for length in (0..file.len()).step_by(step) {
            fs::write(&cut, &file[..length]).unwrap();
            _ = info(&cut);
            _ = exposure(&cut);
            _ = read_exr(&cut);
            if let Ok(raster) = read(&cut) {
                assert!(raster == whole, "{} cut to {length} of {} bytes", path.display(), file.len());
            }
        }
    }
}

#[test]
fn damaged_files_never_panic() {
    let dir = tempfile::tempdir().unwrap();
    let bad = dir.path().join("bad");
    let rounds = std::env::var("NACRE_FUZZ_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(400);
    for (seed, path) in samples(&dir).into_iter().enumerate() {
        let file = fs::read(&path).unwrap();
        let mut dice = Dice(seed as u64 + 77);
        for round in 0..rounds {
            let mut copy = file.clone();
            // Headers come first, so they get their share of the hits.
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
    for file in [huge_png(60_000, 60_000), huge_png(2_000_000, 2), tiff, exr] {
        fs::write(&path, &file).unwrap();
        for error in [info(&path).unwrap_err().to_string(), read(&path).unwrap_err().to_string()] {
            assert!(error.contains("more than") && error.contains("pixel"), "{error}");
        }
    }
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
    says(Path::new("/dev/null"), "not a regular file");
    fs::write(&path, b"").unwrap();
    says(&path, "is empty");
    fs::write(&path, b"hello, this is text").unwrap();
    says(&path, "is not a PNG, JPEG, TIFF, BMP, EXR or Radiance HDR image");
    fs::write(&path, b"\x89PNG\r\n\x1a\n").unwrap();
    says(&path, "truncated or damaged");
}
