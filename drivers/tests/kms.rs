//! The KMS display on a real kernel: the graphics card's output must match the drawn picture.
//!
//! NACRE_TEST_OUTPUT names an output that may be drawn on, NACRE_TEST_FOLDER a folder shared with a program that takes
//! pictures of the screen. For each `N.ppm` in it the test answers with `N.taken`. `tests/lab/run` does so.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests")]

use nacre_drivers::display::kms::{self, Geometry, Settings, Tone, draw};
use nacre_drivers::{Clock, Display, Pattern, SystemClock};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

fn write_ppm(path: &Path, pixels: &[u32], [width, height]: [usize; 2]) {
    let mut bytes = format!("P6\n{width} {height}\n255\n").into_bytes();
    bytes.extend(pixels.iter().flat_map(|p| [(p >> 16) as u8, (p >> 8) as u8, *p as u8]));
    // The rename makes the file appear complete.
    let unfinished = path.with_extension("part");
    std::fs::write(&unfinished, bytes).unwrap();
    std::fs::rename(unfinished, path).unwrap();
}

#[test]
fn the_screen_shows_the_drawn_pattern() {
    let [Ok(output), Ok(folder)] = ["NACRE_TEST_OUTPUT", "NACRE_TEST_FOLDER"].map(std::env::var) else {
        return println!("skipped: no NACRE_TEST_OUTPUT and NACRE_TEST_FOLDER");
    };
    let size_mm = [320.0, 200.0];
    let settings = Settings { output, card: None, size_mm: Some(size_mm), tone: Tone::default() };
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let mut panel = kms::open(&settings, Duration::from_millis(50), &clock).unwrap();
    println!("{:?}", panel.describe());
    let second = kms::open(&settings, Duration::ZERO, &clock).err().unwrap();
    println!("a second master: {second}");
    assert!(second.remedy.contains("/display"));
    let mode = std::fs::read_to_string(format!("/sys/class/drm/card0-{}/modes", settings.output)).unwrap();
    let pixels: Vec<usize> = mode.lines().next().unwrap().split('x').map(|n| n.parse().unwrap()).collect();
    let geometry = Geometry { pixels: [pixels[0], pixels[1]], size_mm };
    let disc = |x, y, diameter_mm| Pattern::Disc { center_mm: [x, y], diameter_mm };
    let patterns = [disc(0.0, 0.0, 100.0), disc(-60.0, 31.3, 17.7), Pattern::Black, disc(80.0, -50.0, 60.0)];
    let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
    for (i, pattern) in patterns.into_iter().enumerate() {
        let begun = SystemClock.now();
        let shown = runtime.block_on(panel.show(pattern)).unwrap();
        assert_eq!(shown.pattern, pattern);
        println!("{pattern:?} after {:?}", shown.since - begun);
        let expected = Path::new(&folder).join(format!("{i}.ppm"));
        write_ppm(&expected, &draw(&pattern, &geometry, &settings.tone).unwrap(), geometry.pixels);
        let taken = expected.with_extension("taken");
        let waits = (0..600).find(|_| {
            std::thread::sleep(Duration::from_millis(100));
            taken.exists()
        });
        assert!(waits.is_some(), "nobody took a picture of {i}");
    }
}
