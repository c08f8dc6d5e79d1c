//! Full disks, interrupts and memory.

#![allow(clippy::unwrap_used)]

use nacre_tests::http::Service;
use nacre_tests::{BENCH, NEVER, Place, binary, listing, nacre};
use serde_json::json;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A series of `count` frames of `width` × `height`; four TIFF files are written, the others are links to them.
fn series(folder: &Path, count: usize, width: usize, height: usize) {
    fs::create_dir_all(folder).unwrap();
    let file = |k: usize| format!("{:06.2}.tif", 180.0 * k as f64 / count as f64);
    for k in 0..count {
        if k < 4 {
            let pixels: Vec<u8> = (0..width * height).map(|i| (60 + 40 * k + i % 23) as u8).collect();
            let image = image::GrayImage::from_raw(width as u32, height as u32, pixels).unwrap();
            write_tiff(&folder.join(file(k)), &image);
        } else {
            fs::hard_link(folder.join(file(k % 4)), folder.join(file(k))).unwrap();
        }
    }
    nacre(["import", folder.to_str().unwrap()]).expect(0);
}

/// An uncompressed little-endian TIFF with one strip and 8 tags.
fn write_tiff(path: &Path, image: &image::GrayImage) {
    let tags: [(u16, u32); 9] = [
        (256, image.width()),
        (257, image.height()),
        (258, 8),
        (259, 1),
        (262, 1),
        (273, 8),
        (277, 1),
        (278, image.height()),
        (279, image.width() * image.height()),
    ];
    let mut bytes = b"II*\0".to_vec();
    bytes.extend((8 + image.as_raw().len() as u32).to_le_bytes());
    bytes.extend(image.as_raw());
    bytes.extend((tags.len() as u16).to_le_bytes());
    for (tag, value) in tags {
        bytes.extend(tag.to_le_bytes());
        bytes.extend(4_u16.to_le_bytes());
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend(value.to_le_bytes());
    }
    bytes.extend(0_u32.to_le_bytes());
    fs::write(path, bytes).unwrap();
}

fn start(series: &Path, out: &Path) -> Child {
    let args = ["reconstruct", "polarization", series.to_str().unwrap(), "--out", out.to_str().unwrap()];
    Command::new(binary()).args(args).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Peak resident memory of a run in KiB, from the kernel's high-water mark, polled until it ends.
pub fn peak_memory(series: &Path, out: &Path) -> u64 {
    let mut child = start(series, out);
    let status = format!("/proc/{}/status", child.id());
    let mut peak = 0;
    while child.try_wait().unwrap().is_none() {
        let text = fs::read_to_string(&status).unwrap_or_default();
        let mark = text
            .lines()
            .find_map(|l| l.strip_prefix("VmHWM:"))
            .and_then(|l| l.trim().trim_end_matches(" kB").parse().ok());
        peak = peak.max(mark.unwrap_or(0));
        std::thread::sleep(Duration::from_millis(2));
    }
    assert!(child.wait().unwrap().success());
    peak
}

#[test]
fn memory_does_not_grow_with_the_number_of_frames() {
    let folder = tempfile::tempdir().unwrap();
    let peak = |count: usize| {
        let (input, out) = (folder.path().join(format!("in{count}")), folder.path().join(format!("out{count}")));
        series(&input, count, 4096, 3072);
        peak_memory(&input, &out)
    };
    let (few, many) = (peak(4), peak(64));
    println!("peak memory: 4 frames {few} KiB, 64 frames {many} KiB of 12.6 Mpixel");
    assert!((many as f64 / few as f64 - 1.0).abs() < 0.1, "{few} {many}");
    // 6 floats per pixel, two frames of 1 byte, the mask and the largest picture: 24 + 2 + 1 + 4 bytes per pixel, plus
    // 64 MiB for the program itself.
    let allowed = 4096 * 3072 * 31 / 1024 + 64 * 1024;
    assert!(many < allowed, "{many} KiB, allowed {allowed}");
}

#[test]
fn an_interrupt_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let (input, out) = (folder.path().join("in"), folder.path().join("out"));
    series(&input, 64, 2048, 2048);
    let child = start(&input, &out);
    // The temporary folder shows that the run has started.
    let begun = Instant::now();
    while listing(folder.path()).len() < 2 && begun.elapsed() < NEVER {
        std::thread::sleep(Duration::from_millis(1));
    }
    Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let done = child.wait_with_output().unwrap();
    assert_eq!(done.status.code(), Some(130), "{}", String::from_utf8_lossy(&done.stderr));
    assert_eq!(listing(folder.path()), ["in"]);
}

/// Runs a shell script with `$NACRE`, `$IN` and `$OUT` set; returns exit code and standard error.
fn shell(script: &str, input: &Path, out: &Path) -> (i32, String) {
    let run = Command::new("sh")
        .args(["-c", script])
        .env("NACRE", binary())
        .env("IN", input)
        .env("OUT", out)
        .output()
        .unwrap();
    (run.status.code().unwrap_or(-1), String::from_utf8_lossy(&run.stderr).into_owned())
}

#[test]
fn a_file_size_limit_is_an_error_that_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (input, out) = (folder.path().join("in"), folder.path().join("out"));
    series(&input, 4, 512, 512);
    let script = r#"trap '' XFSZ; ulimit -f 1000; exec "$NACRE" reconstruct polarization "$IN" --out "$OUT/result""#;
    let (code, message) = shell(script, &input, &out);
    assert_eq!(code, 1, "{message}");
    assert!(message.contains("cannot write") && message.contains("exr"), "{message}");
    assert_eq!(listing(folder.path()), ["in"]);
}

#[test]
fn a_full_disk_is_an_error_that_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (input, out) = (folder.path().join("in"), folder.path().join("disk"));
    series(&input, 4, 512, 512);
    fs::create_dir(&out).unwrap();
    let mount = r#"mount -t tmpfs -o size=4m tmpfs "$OUT" || exit 77;"#;
    let run = r#""$NACRE" reconstruct polarization "$IN" --out "$OUT/result"; code=$?; ls -A "$OUT" >&2; exit $code"#;
    let inside = format!("unshare -m sh -c '{mount} {run}'");
    let (code, message) = shell(&inside, &input, &out);
    if code == 77 || message.contains("unshare failed") || message.contains("not found") {
        println!("skipped: no private mount here ({message})");
        return;
    }
    assert_eq!(code, 1, "{message}");
    let lines: Vec<&str> = message.lines().collect();
    assert!(lines.len() == 1 && lines[0].contains("free some space"), "{message}");
}

/// Address space in which the photographs do not fit: 2 GiB.
const ADDRESS_SPACE_KIB: u64 = 2 << 20;

/// A description of four files: photographs at four angles, or in four exposures.
fn description(kind: &str) -> String {
    let frames = [0, 45, 90, 135].map(|n| match kind {
        "polarization" => json!({ "file": format!("{n:03}.png"), "analyser_deg": n }),
        _ => json!({ "file": format!("{n:03}.png"), "exposure_s": n + 1 }),
    });
    json!({ "kind": kind, "transfer": "linear", "frames": frames }).to_string()
}

/// 64 Mpixel of black in 64 KiB.
fn black() -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(vec![]);
    image::GrayImage::new(8192, 8192).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

#[test]
fn photographs_that_do_not_fit_into_memory_are_refused_by_their_headers() {
    let folder = tempfile::tempdir().unwrap();
    let png = black();
    for (kind, method) in [("polarization", "polarization"), ("exposures", "hdr")] {
        let (input, out) = (folder.path().join(method), folder.path().join("out"));
        fs::create_dir(&input).unwrap();
        fs::write(input.join("frames.json"), description(kind)).unwrap();
        [0, 45, 90, 135].iter().for_each(|n| fs::write(input.join(format!("{n:03}.png")), &png).unwrap());
        let script = format!(r#"ulimit -v {ADDRESS_SPACE_KIB}; exec "$NACRE" reconstruct {method} "$IN" --out "$OUT""#);
        let (code, message) = shell(&script, &input, &out);
        assert_eq!(code, 2, "{method}: {message}");
        for word in ["000.png", "8192 x 8192", "GiB of memory", "allowed", "crop or scale"] {
            assert!(message.contains(word), "{method}: no {word} in {message}");
        }
        assert!(!out.exists());
    }
}

/// `ulimit -d` counts private writable memory, nearly all of which is available to a program that has just started.
#[test]
fn a_limit_of_data_leaves_nearly_all_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let [small, large, out] = ["small", "large", "out"].map(|name| folder.path().join(name));
    series(&small, 4, 512, 512);
    let script = r#"ulimit -d 1048576; exec "$NACRE" reconstruct polarization "$IN" --out "$OUT""#;
    let (code, message) = shell(script, &small, &out);
    assert_eq!(code, 0, "{message}");
    fs::create_dir(&large).unwrap();
    fs::write(large.join("frames.json"), description("polarization")).unwrap();
    [0, 45, 90, 135].iter().for_each(|n| fs::write(large.join(format!("{n:03}.png")), black()).unwrap());
    let (code, message) = shell(script, &large, &folder.path().join("none"));
    assert_eq!(code, 2, "{message}");
    let allowed = message.split(" GiB are allowed").next().and_then(|before| before.rsplit(' ').next());
    let allowed: f64 = allowed.and_then(|number| number.parse().ok()).unwrap_or_default();
    // Three quarters of 1 GiB, minus thread stacks.
    assert!((0.65..0.75).contains(&allowed), "{message}");
}

/// Over REST, uploads that exceed the memory are rejected at once; the service continues.
#[test]
fn uploads_that_do_not_fit_into_memory_are_refused_when_asked_for() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let limit = format!("--as={}", ADDRESS_SPACE_KIB << 10);
    let limited = Command::new("prlimit").args(["--pid", &service.pid().to_string(), &limit]).status();
    assert!(limited.unwrap().success());
    let png = black();
    for (kind, method) in [("polarization", "polarization"), ("exposures", "hdr")] {
        let text = description(kind);
        let names = [0, 45, 90, 135].map(|n| format!("{n:03}.png"));
        let mut parts: Vec<(&str, &str, &[u8])> =
            vec![("kind", "", b"photographs"), ("frames", "frames.json", text.as_bytes())];
        parts.extend(names.iter().map(|name| ("file", name.as_str(), png.as_slice())));
        let id = service.upload(&parts).expect(201).json()["id"].clone();
        let asked = json!({ "upload": id, "method": method });
        let message = service.post("/api/v1/reconstructions", &asked).expect(400).text();
        for word in ["000.png", "8192 x 8192", "GiB of memory", "allowed", "crop or scale"] {
            assert!(message.contains(word), "{method}: no {word} in {message}");
        }
    }
    let none = service.get("/api/v1/reconstructions").expect(200).json();
    assert_eq!(none["items"].as_array().unwrap().len(), 0);
}

/// Concurrent views of one large map take little more memory than one: 12 Mpixel are 48 MiB per channel.
#[test]
fn views_of_a_large_map_are_bounded_in_memory() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let [input, maps] = ["in", "maps"].map(|name| place.text(name));
    nacre(["sim", "render", "--sample", "cd", "--size", "32", "--angles-deg", "0,45,90", "--out", &input]).expect(0);
    nacre(["reconstruct", "polarization", &input, "--out", &maps]).expect(0);
    let map = fs::read(place.path("maps/orientation.exr")).unwrap();
    let upload =
        service.upload(&[("kind", "", b"maps"), ("file", "orientation.exr", &map)]).expect(201).json()["id"].clone();
    let body = json!({ "upload": upload, "method": "map", "options": { "size": [4000, 3000] } });
    let id = service.post("/api/v1/reconstructions", &body).expect(202).json()["id"].as_str().unwrap().to_owned();
    let base = format!("/api/v1/reconstructions/{id}");
    service.until(&base, |job| job["state"] == "done");
    let status = format!("/proc/{}/status", service.pid());
    let peak = || {
        let text = fs::read_to_string(&status).unwrap();
        let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap();
        line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() >> 10
    };
    for (path, times, allowed) in [
        ("maps/orientation.png?width=256", 16, 300),
        ("maps/sigma.png?width=1000", 16, 300),
        ("maps/orientation.npy", 16, 400),
        ("pixel?x=1&y=1", 16, 400),
        ("view", 3, 400),
    ] {
        // Resets the high-water mark, so that it covers only these views.
        fs::write(format!("/proc/{}/clear_refs", service.pid()), "5").unwrap();
        std::thread::scope(|scope| {
            let all: Vec<_> = (0..times).map(|_| scope.spawn(|| service.get(&format!("{base}/{path}")))).collect();
            for answer in all {
                let answer = answer.join().unwrap();
                // A map alone has no photographs, so requests for pixels are rejected.
                assert_eq!(answer.status, if path.starts_with("pixel") { 404 } else { 200 }, "{path}: {}", answer.head);
            }
        });
        println!("{times} times {path}: {} MiB", peak());
        assert!(peak() < allowed, "{path}: {} MiB", peak());
    }
}
