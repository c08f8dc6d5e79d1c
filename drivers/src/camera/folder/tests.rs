//! The folder driver on files of a simple format: `EXPOSURE ISO SECONDS SERIAL` and a word at the end.

use super::{Settings, open};
use crate::camera::photograph::{Channel, Photograph, PhotographReader, Photography, Shot, Taken};
use crate::{Camera, Clock, DeviceError, DeviceResult, Frame, Freshness, Prompt, SystemClock};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime};

const ANY: Freshness = Freshness { steady_since: Duration::ZERO, first_sequence: 0, duration: Duration::ZERO };

struct Words;

impl PhotographReader for Words {
    fn kind(&self, name: &str) -> Option<bool> {
        match Path::new(name).extension()?.to_str()? {
            "raw" => Some(true),
            "jpg" => Some(false),
            _ => None,
        }
    }

    fn shot(&self, file: &Path) -> Result<Shot, String> {
        let text = fs::read_to_string(file).map_err(|e| e.to_string())?;
        let words: Vec<&str> = text.split(' ').collect();
        let [exposure, iso, seconds, serial, ..] = words[..] else { return Err("too short".into()) };
        let number = |word: &str| word.parse::<f64>().ok();
        Ok(Shot {
            raw: self.kind(&file.to_string_lossy()) == Some(true),
            taken: number(seconds).map(|seconds| Taken { seconds, resolution_s: 1.0 }),
            exposure_s: number(exposure),
            iso: number(iso),
            aperture: None,
            model: Some("Acme".into()),
            serial: Some(serial.into()),
        })
    }

    fn read(&self, file: &Path, _: Channel) -> Result<Photograph, String> {
        let shot = self.shot(file)?;
        let text = fs::read_to_string(file).map_err(|e| e.to_string())?;
        let code = text.strip_suffix(" end").ok_or("is incomplete")?.rsplit(' ').next().and_then(|w| w.parse().ok());
        let codes = vec![code.unwrap_or(0); 4];
        Ok(Photograph { shot, width: 2, height: 2, codes, black: 0, white: 255 })
    }

    fn read_bytes(&self, _: &str, _: &[u8], _: Channel) -> Result<Photograph, String> {
        Err("no files in memory".into())
    }
}

/// Acts of the operator on the next requests, in order.
type Acts = Arc<Mutex<Vec<Box<dyn FnOnce() + Send>>>>;

struct Operator {
    acts: Acts,
    asked: Arc<Mutex<Vec<String>>>,
}

impl Prompt for Operator {
    fn ask(&mut self, request: &str) -> std::io::Result<()> {
        self.asked.lock().unwrap().push(request.into());
        let mut acts = self.acts.lock().unwrap();
        if acts.is_empty() {
            return Err(std::io::ErrorKind::Interrupted.into());
        }
        acts.remove(0)();
        Ok(())
    }
}

struct Bench {
    folder: tempfile::TempDir,
    acts: Acts,
    asked: Arc<Mutex<Vec<String>>>,
}

/// Seconds since 1970 on a camera whose clock is wrong by 10 years.
fn camera_now(shift_s: f64) -> f64 {
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap().as_secs_f64();
    (now - 3.15e8 + shift_s).floor()
}

fn photograph(exposure: &str, iso: u32, shift_s: f64, serial: &str, code: u32) -> String {
    format!("{exposure} {iso} {} {serial} {code} end", camera_now(shift_s))
}

impl Bench {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("0.raw"), photograph("0.01", 100, -100.0, "7", 1)).unwrap();
        Self { folder, acts: Acts::default(), asked: Arc::default() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn open(&self) -> DeviceResult<Box<dyn Camera>> {
        let (acts, asked) = (self.acts.clone(), self.asked.clone());
        let prompt = move || Box::new(Operator { acts: acts.clone(), asked: asked.clone() }) as Box<dyn Prompt>;
        let program = Photography { reader: Arc::new(Words), prompt: Arc::new(prompt) };
        let clock: Arc<dyn Clock> = Arc::new(SystemClock);
        let settings = Settings { wait_s: 4.0, ..Settings::new(self.folder.path().to_str().unwrap()) };
        open(&settings, &clock, &program)
    }

    /// The next request is followed by this act.
    fn then(&self, act: impl FnOnce() + Send + 'static) {
        self.acts.lock().unwrap().push(Box::new(act));
    }

    fn writes(&self, name: &str, content: String) {
        let path = self.path(name);
        self.then(move || fs::write(path, content).unwrap());
    }
}

fn run<T>(future: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap().block_on(future)
}

fn take(camera: &mut Box<dyn Camera>) -> DeviceResult<Frame> {
    run(camera.next_frame(ANY))
}

fn fails(camera: &mut Box<dyn Camera>) -> DeviceError {
    take(camera).unwrap_err()
}

#[test]
fn a_photograph_after_the_request_is_taken_and_others_are_not() {
    let bench = Bench::new();
    let mut camera = bench.open().unwrap();
    let info = camera.describe();
    assert!(info.id.contains("Acme s/n 7") && info.by_hand && info.width == 2);
    run(camera.configure(Duration::from_millis(10), 1.0)).unwrap();
    assert!(run(camera.next_frame(Freshness::NEVER)).unwrap().codes.is_empty(), "nobody is asked");
    assert!(bench.asked.lock().unwrap().is_empty());
    bench.writes("1.raw", photograph("0.01", 100, 0.0, "7", 11));
    assert_eq!(take(&mut camera).unwrap().codes, [11; 4]);
    // A late photograph from before the request, a JPEG file, a link, a note, and an incomplete file that is completed.
    let folder = bench.folder.path().to_owned();
    bench.then(move || {
        fs::write(folder.join("2.raw"), photograph("0.01", 100, -50.0, "7", 12)).unwrap();
        fs::write(folder.join("3.jpg"), photograph("0.01", 100, 0.5, "7", 13)).unwrap();
        fs::write(folder.join("3.txt"), "x").unwrap();
        std::os::unix::fs::symlink(folder.join("1.raw"), folder.join("0link.raw")).unwrap();
        fs::create_dir(folder.join("4.raw")).unwrap();
        let whole = photograph("0.01", 100, 0.5, "7", 14);
        fs::write(folder.join("3.raw.part"), &whole[..whole.len() - 3]).unwrap();
        std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(700));
            fs::rename(folder.join("3.raw.part"), folder.join("3.raw")).unwrap();
            std::thread::sleep(Duration::from_millis(700));
            fs::write(folder.join("3.raw"), whole).unwrap();
        });
    });
    assert_eq!(take(&mut camera).unwrap().codes, [14; 4]);
    let asked = bench.asked.lock().unwrap().clone();
    assert_eq!(asked, ["press Enter, then take the photograph"; 2]);
    assert!(bench.path("2.raw").exists() && bench.path("3.raw").exists());
}

#[test]
fn settings_of_the_camera_are_requested_and_compared() {
    let bench = Bench::new();
    let mut camera = bench.open().unwrap();
    run(camera.configure(Duration::from_micros(16_670), 4.0)).unwrap();
    bench.writes("1.raw", photograph("0.01", 400, 0.0, "7", 1));
    let error = fails(&mut camera);
    assert!(
        error.expected.contains("1/60 s") && error.got.contains("1/100 s") && error.got.contains("1.raw"),
        "{error}"
    );
    bench.writes("2.raw", photograph("0.015625", 200, 0.0, "7", 1));
    let error = fails(&mut camera);
    assert!(error.expected.contains("ISO 400") && error.got.contains("ISO 200"), "{error}");
    bench.writes("3.raw", photograph("0.015625", 400, 1.0, "7", 33));
    assert_eq!(take(&mut camera).unwrap().codes, [33; 4]);
    bench.writes("4.raw", photograph("0.015625", 400, 2.0, "8", 1));
    let error = fails(&mut camera);
    assert!(error.expected.contains("s/n 7") && error.got.contains("s/n 8"), "{error}");
    let asked = bench.asked.lock().unwrap().clone();
    assert!(asked[..3].iter().all(|a| a.contains("set the camera to 1/60 s (16.67 ms) and ISO 400")), "{asked:?}");
    assert!(!asked[3].contains("set the camera"), "{asked:?}");
    let refused = run(camera.configure(Duration::from_micros(11_000), 1.0)).unwrap_err();
    assert!(refused.got.contains("1/100 s") && refused.got.contains("1/80 s"), "{refused}");
}

#[test]
fn a_photograph_that_does_not_come_is_an_error_that_names_the_skipped_files() {
    let bench = Bench::new();
    let mut camera = bench.open().unwrap();
    assert!(fails(&mut camera).expected.contains("Enter"), "the operator cancels");
    run(camera.configure(Duration::from_millis(10), 1.0)).unwrap();
    bench.writes("1.raw", "0.01 100 9 7 half".into());
    let error = fails(&mut camera);
    assert!(error.got.contains("1.raw: is incomplete") || error.got.contains("before the request"), "{error}");
    let gone = bench.folder.path().to_owned();
    bench.then(move || fs::remove_dir_all(gone).unwrap());
    assert!(fails(&mut camera).command.contains("watch the folder"));
}

#[test]
fn a_folder_needs_a_photograph() {
    let bench = Bench::new();
    fs::write(bench.path("0.raw"), "garbage").unwrap();
    let error = bench.open().err().unwrap();
    assert!(error.got.contains("0.raw") && error.remedy.contains("one photograph"), "{error}");
    fs::remove_file(bench.path("0.raw")).unwrap();
    assert_eq!(&*bench.open().err().unwrap().got, "none");
    // Of a pair, the raw file.
    fs::write(bench.path("1.raw"), photograph("0.02", 100, 0.0, "7", 1)).unwrap();
    fs::write(bench.path("1.jpg"), photograph("0.01", 100, 0.0, "7", 1)).unwrap();
    assert!(bench.open().unwrap().describe().warnings.is_empty(), "no warning of JPEG");
}

/// The waiting call is dropped at once when its caller is.
#[test]
fn a_cancelled_wait_ends() {
    let bench = Bench::new();
    let mut camera = bench.open().unwrap();
    bench.then(|| ());
    let waited = run(async { tokio::time::timeout(Duration::from_millis(300), camera.next_frame(ANY)).await.is_err() });
    assert!(waited);
}
