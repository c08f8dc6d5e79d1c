//! Pictures rendered by graphics cards, native (software Vulkan without a card) and in the browser, compared with the
//! processor's.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod scenes;

use nacre_processing::image::read_exr;
use nacre_processing::progress::Silent;
use nacre_processing::render::difference;
use nacre_processing::render::gpu::{Kept, Prepared, adapter, timed};
use nacre_tests::chromium::Browser;
use nacre_tests::http::{Service, begin, finished, plan};
use nacre_tests::{Place, nacre};
use scenes::{Chance, LONG, MATERIALS, Material, scene};
use std::path::Path;
use std::process::Command;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Maximum mean CIEDE2000 over lit pixels, averaged over all views; a single view may reach twice as much, because of
/// noise.
const MOST: f64 = 1.0;

/// Relative error of sums over orders and wavelengths: the default of `nacre render`.
const SUMS: f64 = 0.0025;

/// Number of views of each material: all if `NACRE_EVERY_VIEW` is set (`tests/run --long`), otherwise the first two,
/// because each takes up to twenty seconds.
fn views() -> usize {
    if every_view() { 10 } else { 2 }
}

fn every_view() -> bool {
    std::env::var_os("NACRE_EVERY_VIEW").is_some()
}

/// Seed of the views: `NACRE_SEED`, or a fixed one, so that failures result from changes of the code.
fn seed() -> u64 {
    let seed = std::env::var("NACRE_SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(1);
    println!("NACRE_SEED={seed}");
    seed
}

/// All materials, or the one named by `NACRE_MATERIAL`.
fn chosen() -> Vec<Material> {
    let Some(only) = std::env::var_os("NACRE_MATERIAL") else { return MATERIALS.to_vec() };
    let chosen: Vec<_> = MATERIALS.into_iter().chain(LONG).filter(|m| *m.name == *only).collect();
    assert!(!chosen.is_empty(), "NACRE_MATERIAL={only:?} is none of them");
    chosen
}

/// One picture at a time: both the card and the browser may be software on the same processor.
static PICTURES: Mutex<()> = Mutex::new(());

/// Linear sRGB, row by row.
type Picture = Vec<[f32; 3]>;

fn read(path: &Path) -> Picture {
    let map = read_exr(path).unwrap();
    let channel = |name: &str| map.channels[name].clone();
    let [r, g, b] = ["R", "G", "B"].map(channel);
    (0..r.len()).map(|i| [r[i], g[i], b[i]]).collect()
}

fn rendered(dir: &Path, text: &str, more: &[&str]) -> (Picture, serde_json::Value) {
    let [scene, out] = ["a.toml", "a.exr"].map(|name| dir.join(name).to_str().unwrap().to_owned());
    std::fs::write(&scene, text).unwrap();
    let args = ["--json", "render", &scene, "--out", &out, "--force", "--samples"];
    // Exit code 1: the noise after this number of samples exceeds the default bound.
    let report = nacre(args.iter().chain(more)).json();
    (read(Path::new(&out)), report)
}

/// Pixels along a side, and samples on the card and on the processor. Noise must stay well below the bound.
/// `NACRE_EFFORT` multiplies the samples, which separates noise from systematic error.
fn effort(material: &Material) -> [usize; 3] {
    let times = std::env::var("NACRE_EFFORT").ok().and_then(|s| s.parse().ok()).unwrap_or(1);
    let [side, fewer, more] = match material.name {
        // Random samples of a table have a single colour each.
        "table under a sky" => [8, 256, 16_384],
        // Edges within pixels.
        "table in a cylinder" => [8, 512, 2048],
        "maps" => [8, 128, 512],
        // A quarter of these samples left a difference of up to 1.4.
        "maps on a cylinder" => [8, 512, 2048],
        "maps on a mesh" => [8, 512, 4096],
        // The card samples one of the lamp's 16 parts at a time.
        "sinusoid under a lamp with an area" => [8, 512, 128],
        // Few pixels show its orders, at edges of squares within them.
        "maps on a sphere" => [16, 256, 2048],
        // Both sides sample the base randomly, and also a lattice's orders, for which 1024 samples of the processor
        // once left a difference of 2.16.
        "maps on a sphere under a sky"
        | "maps on a cylinder under a sky"
        | "base below maps under a sky"
        | "base below maps on a cylinder under a sky" => [8, 256, 512],
        "lattice under a sky" | "lattice on a cylinder under a sky" => [8, 512, 4096],
        // Both sides sample randomly: a quarter of these samples left up to 2.02 on 8 x 8 pixels, this number at most
        // 1.08.
        "height field on a cylinder under a sky" => [6, 8192, 16_384],
        // As noisy as the flat table on the processor, and also on the card.
        "table on a cylinder under a sky" => [6, 8192, 32_768],
        // The processor samples positions on the lamp.
        "height field" => [8, 64, 4096],
        // Both sides sample the sky randomly.
        "slits under a sky" | "sinusoid of 3 µm under a sky" => [8, 128, 1024],
        "maps on a mesh under a sky" => [8, 512, 4096],
        // Lines within pixels: a sixteenth of these samples left 1.6 and 2.1, the same difference as between the
        // processor with 64 or 128 samples and with 2048.
        "slits of 4 µm" => [8, 1024, 2048],
        // A quarter of these samples left up to 1.2 and 1.7.
        "rectangular of 8 µm" | "lattice of narrow lobes" => [8, 256, 512],
        // The whole disc, including its rims.
        "disc" => [12, 64, 128],
        _ => [8, 64, 128],
    };
    [side, fewer * times, more * times]
}

/// Runs a test for each material in a separate process, two at a time, since software compiles shaders on one
/// processor.
fn all_in_processes(test: &str) {
    let waiting = Mutex::new(MATERIALS.iter());
    let work = || {
        loop {
            let next = waiting.lock().unwrap_or_else(PoisonError::into_inner).next();
            let Some(material) = next else { return };
            let mut child = Command::new(std::env::current_exe().unwrap());
            let output =
                child.args(["--exact", test, "--nocapture"]).env("NACRE_MATERIAL", material.name).output().unwrap();
            println!("{}", String::from_utf8_lossy(&output.stdout));
            assert!(output.status.success(), "{}: {}", material.name, String::from_utf8_lossy(&output.stderr));
        }
    };
    std::thread::scope(|scope| {
        scope.spawn(work);
        work();
    });
}

/// Renders views of a material on the card and on the processor.
fn compared(material: &Material, dir: &Path, chance: &mut Chance) {
    let (mut worst, mut sum) = (0.0_f64, 0.0);
    let [side, fewer, more] = effort(material);
    let views = views();
    // One for all views, because drivers take seconds to compile the shaders.
    let mut card = Kept::default();
    for _ in 0..views {
        let text = scene(*material, side, chance);
        let parsed = toml::from_str(&text).unwrap();
        let processor = timed(&parsed, dir, more, SUMS, None).unwrap().pixels;
        let found = difference(&processor, &timed(&parsed, dir, fewer, SUMS, Some(&mut card)).unwrap().pixels);
        assert!(found.lit > side * side / 12, "hardly anything is lit:\n{text}");
        println!("ΔE2000 {:.3} over {} pixels", found.mean, found.lit);
        worst = worst.max(found.mean);
        sum += found.mean / views as f64;
        assert!(found.mean <= 2.0 * MOST, "ΔE2000 {} over {} pixels:\n{text}", found.mean, found.lit);
    }
    println!("{}: mean ΔE2000 {sum:.3}, worst view {worst:.3}", material.name);
    assert!(sum <= MOST, "{}: {sum}", material.name);
}

#[test]
fn a_card_renders_what_the_processor_renders() {
    if let Err(why) = adapter() {
        println!("skipped: {why}");
        return;
    }
    let _alone = PICTURES.lock().unwrap_or_else(PoisonError::into_inner);
    match chosen().as_slice() {
        [material] => {
            let dir = tempfile::tempdir().unwrap();
            scenes::files(dir.path());
            compared(material, dir.path(), &mut Chance(seed()));
        }
        _ => all_in_processes("a_card_renders_what_the_processor_renders"),
    }
}

/// Software renderers that may replace a card.
const SOFTWARE: [&str; 3] = ["llvmpipe", "SwiftShader", "Microsoft Basic Render"];

/// Cards render all sums that are too long for software renderers.
#[test]
fn long_sums_are_for_cards_that_are_no_software() {
    let Ok(name) = adapter() else {
        println!("skipped: there is no card");
        return;
    };
    let _alone = PICTURES.lock().unwrap_or_else(PoisonError::into_inner);
    let dir = tempfile::tempdir().unwrap();
    scenes::files(dir.path());
    let mut chance = Chance(seed());
    for material in &LONG {
        if SOFTWARE.iter().any(|software| name.contains(software)) {
            let parsed = toml::from_str(&scene(*material, 8, &mut chance)).unwrap();
            let refused = timed(&parsed, dir.path(), 4, SUMS, Some(&mut Kept::default())).unwrap_err();
            assert!(refused.to_string().contains("ends long sums early"), "{}: {refused}", material.name);
        } else {
            compared(material, dir.path(), &mut chance);
        }
    }
}

#[test]
fn the_command_renders_on_a_card() {
    let dir = tempfile::tempdir().unwrap();
    scenes::files(dir.path());
    let text = scene(MATERIALS[0], 16, &mut Chance(1));
    let (card, report) = rendered(dir.path(), &text, &["16", "--gpu"]);
    match adapter() {
        Ok(name) => assert_eq!(report["device"], name),
        Err(why) => assert!(report["warnings"].to_string().contains(&why), "{report}"),
    }
    let (processor, report) = rendered(dir.path(), &text, &["16"]);
    assert_eq!(report["device"], "processor");
    // A tenth of the samples above leaves three times the noise.
    assert!(difference(&processor, &card).mean < 3.0 * MOST);
}

#[test]
fn scenes_that_cards_do_not_do_go_to_the_processor() {
    let dir = tempfile::tempdir().unwrap();
    scenes::files(dir.path());
    let text = scene(MATERIALS[0], 16, &mut Chance(1))
        .replace("fov_deg = 14", "fov_deg = 14\naperture_mm = 2\nfocus_mm = 500");
    let (_, report) = rendered(dir.path(), &text, &["16", "--gpu"]);
    assert_eq!(report["device"], "processor");
    assert!(report["warnings"].to_string().contains("an aperture"), "{report}");
}

/// Rendering interfaces of a browser, with the mean CIEDE2000 of each rendered material.
type Ways = [(&'static str, Vec<f64>); 2];

/// Renders views of a material in a browser by the requested and available interfaces.
fn draw(browser: &Browser, dir: &Path, material: &Material, asked: [bool; 2], chance: &mut Chance, ways: &mut Ways) {
    let [side, fewer, more] = effort(material);
    let mut sums = asked.map(|asked| asked.then_some(0.0));
    let views = if every_view() { 10 } else { 1 };
    let begun = Instant::now();
    for _ in 0..views {
        let text = scene(*material, side, chance);
        let parsed = toml::from_str(&text).unwrap();
        let processor = timed(&parsed, dir, more, SUMS, None).unwrap().pixels;
        let view = Prepared::new(&parsed, dir, SUMS, usize::MAX, &Silent).unwrap().bytes();
        let hex: String = view.iter().map(|byte| format!("{byte:02x}")).collect();
        for ((way, _), sum) in ways.iter().zip(&mut sums) {
            let Some(so_far) = *sum else { continue };
            let drawn = browser.run(&format!("return window.draw('{way}', '{hex}', {side}, {fewer})"));
            let Some(values) = drawn.as_array() else {
                println!("skipped: {way}: {drawn}");
                *sum = None;
                continue;
            };
            let values: Vec<f32> = values.iter().map(|v| v.as_f64().unwrap() as f32).collect();
            let picture: Picture = values.chunks_exact(4).map(|p| [p[0], p[1], p[2]]).collect();
            let found = difference(&processor, &picture);
            assert!(found.lit > side * side / 12, "hardly anything is lit:\n{text}");
            assert!(found.mean <= 2.0 * MOST, "{way}: ΔE2000 {} over {} pixels:\n{text}", found.mean, found.lit);
            *sum = Some(so_far + found.mean / views as f64);
        }
    }
    println!("{}: {:.1} s", material.name, begun.elapsed().as_secs_f64());
    for ((way, means), mean) in ways.iter_mut().zip(sums).filter_map(|(way, sum)| Some((way, sum?))) {
        println!("{} by {way}: mean ΔE2000 {mean:.3} of {views}", material.name);
        assert!(views == 1 || mean <= MOST, "{} by {way}: {mean}", material.name);
        means.push(mean);
    }
}

/// Renders a view, given as hexadecimal digits, in a browser by one interface: its pixels, or the reason why it is
/// unavailable.
const DRAW: &str = "return Promise.all([import('/assets/parsed.js'), import('/assets/card.js')]).then(([{ parseView }, { chosen }]) => {
    window.draw = async (way, hex, side, samples) => {
        const bytes = Uint8Array.from({ length: hex.length / 2 }, (_, k) => parseInt(hex.slice(2 * k, 2 * k + 2), 16));
        const view = parseView(bytes.buffer);
        const card = await chosen(way, view);
        if (card.way.toLowerCase() !== way) return card.why;
        const painter = card.painter(document.createElement('canvas'));
        painter.load(view);
        for (let k = 0; k < samples; k++) {
            painter.add(side, side, 1);
            if (k % 32 === 31) await painter.done();
        }
        const pixels = Array.from(await painter.pixels());
        painter.close();
        card.close();
        return pixels;
    };
})";

#[test]
fn browsers_draw_every_kind_of_sample_by_webgpu_and_webgl2() {
    let _alone = PICTURES.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(browser) = Browser::with_webgpu() else { return };
    let mut chance = Chance(seed());
    let place = Place::with_bench("", "camera = { width = 32, height = 32 }");
    let service = Service::start(&place, &[]);
    browser.open(&format!("http://{}/#/calibrate", service.address));
    browser.run(DRAW);
    let dir = tempfile::tempdir().unwrap();
    scenes::files(dir.path());
    let mut ways: Ways = [("webgpu", vec![]), ("webgl2", vec![])];
    let chosen = chosen();
    for (k, material) in chosen.iter().enumerate() {
        // Native cards also use the WebGPU shader; WebGL2 has a translation of it.
        let asked = [every_view() || k % 3 == 0, true];
        draw(&browser, dir.path(), material, asked, &mut chance, &mut ways);
    }
    for (way, found) in ways.iter().filter(|(_, found)| !found.is_empty()) {
        let mean = found.iter().sum::<f64>() / found.len() as f64;
        println!("{way}: mean ΔE2000 {mean:.3} of {} materials", found.len());
        assert!(mean <= MOST, "{way}: {mean}");
    }
    assert_eq!(ways[1].1.len(), chosen.len(), "not all was drawn by WebGL2");
}

/// View of a result in a pose, as produced by `daemon/service/src/view.rs`.
fn of_result(folder: &Path, normal: [f64; 3], up: [f64; 3], light: [f64; 3]) -> String {
    format!(
        "[camera]\nposition = [0, 0, 500]\ntarget = [0, 0, 0]\nfov_deg = 14\nwidth = 32\nheight = 32\n\
         [[shape]]\ntype = \"plane\"\nnormal = {normal:?}\nup = {up:?}\nsize = [100, 100]\nmaterial = \"sample\"\n\
         [[light]]\ntype = \"point\"\nposition = {light:?}\nilluminance = {}\nsigma_mm = 10\n\
         [material.sample]\ncoverage = 0.97\n[material.sample.base]\nalbedo = [0.02, 0.02, 0.02]\n\
         [material.sample.diffraction]\ntype = \"grating\"\nrelief = {{ depth_um = 0.1 }}\nperiod_um = 1.0\nmaps = {:?}\nreflectance = \"aluminium\"\n",
        1.0,
        folder.join("orientation.exr")
    )
}

#[test]
fn the_browser_shows_what_the_processor_renders() {
    let _alone = PICTURES.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(browser) = Browser::start() else { return };
    let mut chance = Chance(seed());
    let place = Place::with_bench("", "camera = { width = 128, height = 128 }");
    let service = Service::start(&place, &[]);
    let url = format!("http://{}", service.address);
    let id = begin(&service, &plan(8, 10.0));
    finished(&service, &id);
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["has_results"] == true);
    let dir = tempfile::tempdir().unwrap();
    let map = service.get(&format!("/api/v1/reconstructions/{id}/maps/orientation.exr")).expect(200);
    std::fs::write(dir.path().join("orientation.exr"), &map.body).unwrap();

    browser.open(&format!("{url}/#/result/{id}"));
    browser.click("#to-view");
    let view = "document.querySelector('#view').viewer";
    // Software takes seconds for a sample of the whole page.
    browser.until(view);
    browser.run(&format!("{view}.change({{ quality: 0.03 }}, false)"));
    browser.until(&format!("{view}.painter.count >= {view}.enough()"));
    browser.both("view");
    // The page's own frames, which have another size, are suspended.
    browser.run("window.frames_of = requestAnimationFrame; window.requestAnimationFrame = (f) => { window.kept = f; return 1; }");
    let (mut worst, mut sum) = (0.0_f64, 0.0);
    for _ in 0..views() {
        let [pan, tilt] = [(); 2].map(|()| chance.between(-35.0, 35.0));
        let [azimuth, elevation] = [chance.between(0.0, 360.0), chance.between(45.0, 80.0)];
        browser.run(&format!(
            "{view}.change({{ pan: {pan}, tilt: {tilt}, azimuth: {azimuth}, elevation: {elevation}, quality: 0.0025 }}, false)"
        ));
        // A few samples per call, and the result is read, because long calls are interrupted.
        let add = format!(
            "const p = {view}.painter; for (let k = 0; k < 32; k++) p.add(32, 32, 1); return p.pixels().then((v) => Array.from(v));"
        );
        let values = (0..16).fold(serde_json::Value::Null, |_, _| browser.run(&add));
        let values: Vec<f32> = values.as_array().unwrap().iter().map(|v| v.as_f64().unwrap() as f32).collect();
        let browsers: Picture = values.chunks_exact(4).map(|p| [p[0], p[1], p[2]]).collect();
        let turned = |v| scenes::turned(v, tilt, pan);
        let light = scenes::around(azimuth, elevation, 490.0);
        let text = of_result(dir.path(), turned([0.0, 0.0, 1.0]), turned([0.0, 1.0, 0.0]), light);
        let (processor, _) = rendered(dir.path(), &text, &["4096"]);
        let found = difference(&processor, &browsers);
        assert!(found.lit > 20, "hardly anything is lit:\n{text}");
        worst = worst.max(found.mean);
        sum += found.mean / views() as f64;
        assert!(found.mean <= 2.0 * MOST, "ΔE2000 {} over {} pixels:\n{text}", found.mean, found.lit);
    }
    browser.run("window.requestAnimationFrame = window.frames_of; window.kept(0)");
    println!("browser: mean ΔE2000 {sum:.3}, worst view {worst:.3}");
    assert!(sum <= MOST, "{sum}");
    // A link restores the view, and the maps can be shown instead.
    browser.run(&format!("{view}.change({{ pan: 12, tilt: -20, azimuth: 200, quality: 0.03 }})"));
    browser.until("location.hash.includes('azimuth=200')");
    let link = browser.run("return location.href").as_str().unwrap().to_owned();
    browser.open("about:blank");
    browser.open(&link);
    browser.until(&format!("{view}.state.azimuth === 200 && {view}.painter.count >= {view}.enough()"));
    browser.click("[data-key=orientation]");
    browser.until(&format!("{view}.painter.count >= {view}.enough()"));
    browser.both("view-orientation");
    let said = browser.call("POST", "/se/log", &serde_json::json!({ "type": "browser" }));
    let severe = |entry: &&serde_json::Value| entry["level"] == "SEVERE";
    let errors: Vec<_> = said.as_array().unwrap().iter().filter(severe).collect();
    assert!(errors.is_empty(), "{errors:?}");
}
