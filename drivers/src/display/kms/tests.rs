//! Tests of the display on a fake screen, with and without failures.

use super::*;
use std::sync::Mutex;

#[derive(Default)]
struct State {
    pictures: Vec<Vec<u32>>,
    /// Another program draws on the screen.
    meddle: bool,
    fail: Option<io::ErrorKind>,
}

struct FakeScreen(Arc<Mutex<State>>);

const GEOMETRY: Geometry = Geometry { pixels: [64, 40], size_mm: [160.0, 100.0] };

impl Screen for FakeScreen {
    fn geometry(&self) -> Geometry {
        GEOMETRY
    }

    fn refresh(&self) -> Duration {
        Duration::from_millis(16)
    }

    fn flip(&mut self, pixels: &[u32]) -> io::Result<()> {
        let mut state = self.0.lock().unwrap();
        if let Some(kind) = state.fail {
            return Err(kind.into());
        }
        state.pictures.push(pixels.to_vec());
        Ok(())
    }

    fn shown(&mut self) -> io::Result<Vec<u32>> {
        let state = self.0.lock().unwrap();
        let mut shown = state.pictures.last().unwrap().clone();
        if state.meddle {
            shown[70] ^= 1;
            shown[0] ^= 1;
        }
        Ok(shown.chunks(64).step_by(ROWS_APART).flatten().copied().collect())
    }
}

fn panel() -> (KmsPanel, Arc<Mutex<State>>, crate::camera::v4l2::fake::FakeClock) {
    let state = Arc::new(Mutex::new(State::default()));
    let clock = crate::camera::v4l2::fake::FakeClock::default();
    let screen = Box::new(FakeScreen(state.clone()));
    let response = Duration::from_millis(50);
    let panel = KmsPanel::new(screen, "panel", Tone::default(), response, Arc::new(clock.clone())).unwrap();
    (panel, state, clock)
}

fn show(panel: &mut KmsPanel, pattern: Pattern) -> DeviceResult<Shown> {
    tokio::runtime::Builder::new_current_thread().build().unwrap().block_on(panel.show(pattern))
}

const DISC: Pattern = Pattern::Disc { center_mm: [10.0, -20.0], diameter_mm: 40.0 };

#[test]
fn a_pattern_is_acknowledged_when_it_can_be_seen_and_the_panel_is_black_before_and_after() {
    let (mut panel, state, clock) = panel();
    assert_eq!(panel.describe().size_mm, GEOMETRY.size_mm);
    assert_eq!(clock.now(), Duration::from_millis(66));
    let shown = show(&mut panel, DISC).unwrap();
    assert_eq!((shown.since, shown.pattern), (Duration::from_millis(132), DISC));
    drop(panel);
    let pictures = &state.lock().unwrap().pictures;
    let black = vec![0; 64 * 40];
    assert!(pictures.len() == 3 && pictures[0] == black && pictures[2] == black);
    assert_eq!(pictures[1], draw(&DISC, &GEOMETRY, &Tone::default()).unwrap());
}

#[test]
fn failed_patterns_are_not_acknowledged() {
    let (mut panel, state, _) = panel();
    state.lock().unwrap().meddle = true;
    assert_eq!(show(&mut panel, DISC).unwrap_err().class, Class::Retry);
    state.lock().unwrap().meddle = false;
    let far = Pattern::Disc { center_mm: [90.0, 0.0], diameter_mm: 1.0 };
    assert_eq!(show(&mut panel, far).unwrap_err().class, Class::Setup);
    assert_eq!(state.lock().unwrap().pictures.len(), 2, "nothing was drawn of it");
}

#[test]
fn errors_contain_a_remedy() {
    let (mut panel, state, _) = panel();
    for (kind, class, word) in [
        (io::ErrorKind::PermissionDenied, Class::Setup, "/display"),
        (io::ErrorKind::ResourceBusy, Class::Setup, "desktop"),
        (io::ErrorKind::TimedOut, Class::Retry, "switch the panel on"),
        (io::ErrorKind::Other, Class::Lost, "cable"),
    ] {
        state.lock().unwrap().fail = Some(kind);
        let error = show(&mut panel, DISC).unwrap_err();
        assert!(error.class == class && error.remedy.contains(word), "{error}");
    }
}

#[test]
fn settings_are_checked() {
    let text = r#"{"driver": {"kind": "kms", "output": "HDMI-A-1", "tone": {"gamma": 2.2}}}"#;
    let config: crate::display::DisplayConfig = serde_json::from_str(text).unwrap();
    let crate::display::DisplayDriver::Kms(good) = config.driver else { panic!() };
    good.check().unwrap();
    let bad = [
        Settings { output: "../card0".into(), ..good.clone() },
        Settings { size_mm: Some([f64::NAN, 1.0]), ..good.clone() },
        Settings { tone: Tone::Gamma(0.0), ..good.clone() },
    ];
    assert!(bad.iter().all(|s| s.check().is_err()));
    let page = r#"{"driver": {"kind": "page", "size_mm": [300.0, 200.0]}}"#;
    let config: crate::display::DisplayConfig = serde_json::from_str(page).unwrap();
    assert!(config.open(&(Arc::new(crate::SystemClock) as Arc<dyn Clock>)).is_none());
}

#[test]
fn an_output_that_is_not_there_is_a_setup_error() {
    let settings = Settings { output: "Nowhere-9".into(), card: None, size_mm: None, tone: Tone::default() };
    let clock: Arc<dyn Clock> = Arc::new(crate::SystemClock);
    let error = open(&settings, Duration::ZERO, &clock).err().unwrap();
    assert_eq!(error.class, Class::Setup, "{error}");
}
