//! Device commands on a simulated bench with a slowly settling lamp.

use super::sequencer::prepare;
use super::{BenchController, Devices};
use crate::plan::Plan;
use async_trait::async_trait;
use nacre_base::progress::Silent;
use nacre_drivers::{Clock, DeviceResult, Flash, FlashInfo, HandStage, Pattern, Prompt, Switched};
use nacre_sim::{Bench, BenchConfig, FaultConfig, FaultKind, FaultyDevice, SharedBench, SimDevice};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const SETTLING: Duration = Duration::from_secs(10);

/// A lamp that reports a future time of steady light instead of waiting for it.
struct SlowLamp {
    clock: SharedBench,
    on: bool,
}

#[async_trait]
impl Flash for SlowLamp {
    fn describe(&self) -> FlashInfo {
        FlashInfo { id: "slow lamp".into(), settling_s: SETTLING.as_secs_f64(), max_on_s: 60.0 }
    }

    async fn switch(&mut self, on: bool) -> DeviceResult<Switched> {
        self.on = on;
        Ok(Switched { since: self.clock.now() + SETTLING, on })
    }

    async fn is_on(&mut self) -> DeviceResult<bool> {
        Ok(self.on)
    }
}

fn bench() -> (SharedBench, Devices) {
    bench_with(vec![])
}

fn bench_with(faults: Vec<FaultConfig>) -> (SharedBench, Devices) {
    let mut config = BenchConfig { faults, ..BenchConfig::default() };
    (config.camera.width, config.camera.height) = (16, 16);
    let bench = SharedBench::new(Bench::new(&config, &Silent).unwrap());
    let device = || Box::new(SimDevice::new(Box::new(bench.clone())).unwrap());
    let flash = SlowLamp { clock: bench.clone(), on: false };
    let devices = Devices { stage: device(), camera: device(), display: device(), flash: Some(Box::new(flash)) };
    (bench, devices)
}

fn run<T>(future: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().build().unwrap().block_on(future)
}

#[test]
fn a_lamp_that_settles_for_long_is_waited_for() {
    let (bench, mut devices) = bench();
    let mut controller = BenchController::new(&mut devices);
    let (frame, lit) = run(async {
        controller.prepare(false).await?;
        controller.expose(Duration::from_millis(8), 1.0).await?;
        controller.switch(true).await?;
        let lit = bench.now();
        DeviceResult::Ok((controller.fresh().await?.0, lit))
    })
    .unwrap();
    assert!(frame.stamp.timestamp >= lit + SETTLING + Duration::from_millis(8), "{:?} after {lit:?}", frame.stamp);
}

/// A change that follows at once is steady before the lamp, without being taken for a clock that was set back.
#[test]
fn other_devices_are_used_while_a_lamp_settles() {
    let (_bench, mut devices) = bench();
    let mut controller = BenchController::new(&mut devices);
    run(async {
        controller.switch(true).await?;
        controller.show(Pattern::Disc { center_mm: [0.0, 0.0], diameter_mm: 50.0 }).await?;
        controller.cover(false).await?;
        controller.dark().await
    })
    .unwrap();
}

/// Whenever the clock is set back, the first frame after a change of the exposure has the new exposure, or an error
/// results. The first time reported by the camera after a preparation may be the wrong one.
#[test]
fn a_clock_that_is_set_back_leaves_no_frame_with_the_earlier_exposure() {
    let lit = |faults| {
        let (_bench, mut devices) = bench_with(faults);
        // Removes waits for the lamp.
        devices.flash = None;
        let mut controller = BenchController::new(&mut devices);
        run(async {
            for exposure_us in [4000, 1000] {
                controller.prepare(true).await?;
                controller.show(Pattern::Disc { center_mm: [0.0, 0.0], diameter_mm: 100.0 }).await?;
                // Frames accumulate in the camera meanwhile.
                controller.turn(20.0).await?;
                controller.expose(Duration::from_micros(exposure_us), 1.0).await?;
            }
            let codes = controller.fresh().await?.0.codes;
            DeviceResult::Ok(codes.iter().map(|c| f64::from(*c)).sum::<f64>())
        })
    };
    let light = lit(vec![]).unwrap();
    let mut ends = [0, 0];
    for after in 0..40 {
        let fault = FaultConfig { device: FaultyDevice::Clock, kind: FaultKind::SetBack, after, times: Some(1) };
        let found = lit(vec![fault]);
        ends[usize::from(found.is_ok())] += 1;
        match found {
            Ok(found) => assert!((found / light - 1.0).abs() < 0.05, "after {after} commands: {found} {light}"),
            Err(error) => assert!(error.to_string().contains("clock was set back"), "{error}"),
        }
    }
    assert!(ends[0] > 5 && ends[1] > 0, "{ends:?}");
}

/// As after a pause: an analyser that the plan does not rotate must not have moved.
#[test]
fn an_analyser_that_the_plan_leaves_alone_is_compared() {
    let plan: Plan = toml::from_str("kind = \"flash\"").unwrap();
    let (_bench, mut devices) = bench();
    let mut controller = BenchController::new(&mut devices);
    run(async {
        controller.turn(20.0).await.unwrap();
        prepare(&mut controller, &plan).await.unwrap();
        let fixed_analyser_deg = controller.fixed_analyser_deg.unwrap();
        assert!((fixed_analyser_deg - 20.0).abs() < 0.1, "{fixed_analyser_deg}");
        prepare(&mut controller, &plan).await.unwrap();
        for moved in [20.4, 65.0, -20.0] {
            controller.turn(moved).await.unwrap();
            let error = prepare(&mut controller, &plan).await.unwrap_err().to_string();
            assert!(
                error.contains("simulated stage")
                    && error.contains(&format!("turn the analyser back to {fixed_analyser_deg:.3}°")),
                "{error}"
            );
        }
        controller.turn(20.0).await.unwrap();
        prepare(&mut controller, &plan).await.unwrap();
        assert_eq!(controller.fixed_analyser_deg, Some(fixed_analyser_deg));
    });
}

struct RecordedPrompts(Arc<Mutex<Vec<String>>>);

impl Prompt for RecordedPrompts {
    fn ask(&mut self, request: &str) -> std::io::Result<()> {
        self.0.lock().unwrap().push(request.into());
        Ok(())
    }
}

/// A person is asked to rotate an analyser back if its angle is unknown or has changed, but not before the original
/// angle is known.
#[test]
fn a_person_is_asked_to_turn_the_analyser_back() {
    let plan: Plan = toml::from_str("kind = \"flash\"").unwrap();
    let (bench, mut devices) = bench();
    let prompts = Arc::new(Mutex::new(vec![]));
    devices.stage = Box::new(HandStage::new(Box::new(RecordedPrompts(prompts.clone())), Arc::new(bench), None));
    let mut controller = BenchController::new(&mut devices);
    run(async {
        prepare(&mut controller, &plan).await.unwrap();
        assert_eq!((controller.fixed_analyser_deg, prompts.lock().unwrap().len()), (None, 0));
        controller.fixed_analyser_deg = Some(37.0);
        for _ in 0..2 {
            prepare(&mut controller, &plan).await.unwrap();
            assert_eq!(*prompts.lock().unwrap(), ["turn the analyser to 37° and press Enter"]);
        }
    });
}
