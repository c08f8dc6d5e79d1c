//! Bench control of a run: sets each state, captures fresh frames, and passes them to storage.

use super::bench_controller::BenchController;
use super::frame_writer::{Message, Shot};
use super::series::Decision;
use super::state::{Control, Input, State};
use super::watch::Watch;
use crate::failure::Failure;
use crate::plan::{Added, Plan, Step, groups};
use crate::session::{Commit, Entry, SoFar};
use nacre_base::Error;
use nacre_drivers::{Class, DeviceError, DeviceResult};
use nacre_image::Averaging;
use std::time::{Duration, Instant};
use tokio::sync::mpsc::{Sender, UnboundedReceiver};
use tokio::sync::oneshot;

/// Maximum number of attempts at a step after transient errors.
const ATTEMPTS: u32 = 3;

/// Tolerance for an unmoved analyser: stages repeat an angle to a few hundredths of a degree, and 0.1° changes the
/// transmitted light by less than 0.4 % of its mean.
const FIXED_TOLERANCE_DEG: f64 = 0.1;

/// Decisions about the continuation of a series.
pub type Decisions = UnboundedReceiver<nacre_base::Result<Decision>>;

/// State of a run through a plan.
pub struct Sequencer<'a> {
    /// Device commands.
    pub controller: BenchController<'a>,
    /// Interlocks.
    pub watch: &'a Watch,
    /// Control of the run.
    pub control: &'a Control,
    /// Plan of the session.
    pub plan: &'a Plan,
    /// Exposure of steps without a stated one.
    pub exposure: Duration,
    /// Receives frames and journal entries.
    pub out: Sender<Message>,
    /// Duration of pauses on the wall clock.
    pub paused: Duration,
    /// True if the devices are in a known state.
    pub prepared: bool,
}

/// Runs `work` until it ends, an interlock opens or the run is aborted, whichever comes first.
pub async fn guarded<T>(
    watch: &Watch,
    control: &Control,
    work: impl Future<Output = Result<T, Failure>>,
) -> Result<T, Failure> {
    // No device moves before the interlocks are known to hold.
    watch.check().await?;
    tokio::select! {
        biased;
        _ = control.until(|s| s == State::Aborting) => Err(Error::Cancelled.into()),
        error = watch.broken() => Err(error.into()),
        result = work => result,
    }
}

impl Sequencer<'_> {
    /// Captures all groups with missing frames. The light is switched off afterwards in any case.
    ///
    /// For an adaptive series, `further` then supplies the additions so far and the channel of decisions.
    ///
    /// # Errors
    /// Those of devices and interlocks, with the step; `Cancelled` if the run was stopped. `Cancelled` also if frames
    /// can no longer be stored; the storage thread reports the cause.
    pub async fn capture_all(
        &mut self,
        steps: &[Step],
        missing: &[bool],
        further: Option<(Vec<Added>, &mut Decisions)>,
    ) -> Result<(), Failure> {
        let mut result = self.capture_planned(steps, missing).await;
        if let Some((chosen, decisions)) = further.filter(|_| result.is_ok()) {
            result = self.capture_additions(chosen, decisions).await;
        }
        let dark = self.controller.dark().await;
        if dark.is_ok() {
            self.control.set_dark();
        }
        result.and(dark.map_err(Failure::from))
    }

    async fn capture_planned(&mut self, steps: &[Step], missing: &[bool]) -> Result<(), Failure> {
        let mut first = 0;
        for group in groups(steps) {
            if missing[first] {
                self.wait_while_paused().await?;
                self.with_retries(group, first).await?;
            }
            first += group.len();
        }
        Ok(())
    }

    /// Captures the decided additions until the series ends.
    async fn capture_additions(&mut self, mut chosen: Vec<Added>, decisions: &mut Decisions) -> Result<(), Failure> {
        loop {
            let decision = async {
                let gone = || Error::input("choosing what comes next", "ended unexpectedly", "resume the session");
                Ok(decisions.recv().await.ok_or_else(gone)??)
            };
            match guarded(self.watch, self.control, decision).await? {
                Decision::Next { added, so_far } => {
                    let (sigma_deg, undecided) = match so_far {
                        SoFar::Sigma(s) => (s.sigma_deg, None),
                        SoFar::Fringes(f) => (None, f.undecided),
                    };
                    self.capture_addition(&mut chosen, Entry::Chosen { added, sigma_deg, undecided }, added).await?;
                }
                Decision::Last(added) => {
                    let entry = Entry::Chosen { added, sigma_deg: None, undecided: None };
                    return self.capture_addition(&mut chosen, entry, added).await;
                }
                Decision::End(end) => return self.note(Entry::Ended(end)).await,
            }
        }
    }

    /// Captures the frames of one addition.
    async fn capture_addition(&mut self, chosen: &mut Vec<Added>, entry: Entry, added: Added) -> Result<(), Failure> {
        let known = self.plan.steps_with(chosen).len();
        // Written to the journal before any of its frames, so that a resumed session captures the same.
        self.note(entry).await?;
        chosen.push(added);
        let steps = self.plan.steps_with(chosen);
        for i in known..steps.len() {
            self.wait_while_paused().await?;
            self.with_retries(&steps[i..=i], i).await?;
        }
        Ok(())
    }

    /// Waits while the run is paused; `Cancelled` if it must stop.
    async fn wait_while_paused(&mut self) -> Result<(), Failure> {
        loop {
            match self.control.state() {
                State::Running => return Ok(()),
                State::Pausing => {
                    let begun = Instant::now();
                    self.controller.dark().await?;
                    self.controller.stopwatch.pause();
                    self.prepared = false;
                    // A paused session has stored all captured frames.
                    self.flush().await;
                    // Before the pause event, so that clients that receive it see the state `paused`. A request that
                    // came meanwhile is handled in the next iteration.
                    let _ = self.control.send(Input::Settled);
                    self.note(Entry::Paused).await?;
                    self.flush().await;
                    self.control.until(|s| s != State::Paused).await;
                    self.watch.begin_again().await;
                    self.paused += begun.elapsed();
                }
                State::Resuming => {
                    guarded(self.watch, self.control, prepare(&mut self.controller, self.plan)).await?;
                    self.prepared = true;
                    let _ = self.control.send(Input::Settled);
                }
                _ => return Err(Error::Cancelled.into()),
            }
        }
    }

    /// Captures one group, with retries after transient errors.
    async fn with_retries(&mut self, group: &[Step], first: usize) -> Result<(), Failure> {
        let mut first_failure = None;
        for attempt in 1.. {
            let work = async {
                if !self.prepared {
                    prepare(&mut self.controller, self.plan).await?;
                }
                capture_group(&mut self.controller, self.watch, self.plan, self.exposure, &self.out, group, first).await
            };
            let result = guarded(self.watch, self.control, work).await;
            self.prepared = true;
            let Err(failure) = result else { return Ok(()) };
            let passing = matches!(&failure, Failure::Device(e) if matches!(e.class, Class::Retry | Class::Lost));
            let step = &group[0].file;
            if !passing {
                return Err(failure.at(step));
            }
            if attempt == ATTEMPTS {
                // The first failure is the most informative.
                return Err(first_failure.unwrap_or(failure).at(&format!("{step} (tried {ATTEMPTS} times)")));
            }
            self.prepared = false;
            // The preparation of the next attempt switches the light off too, and reports failures.
            let _ = self.controller.dark().await;
            self.note(Entry::Retried { reason: format!("{step}: {failure}") }).await?;
            first_failure.get_or_insert(failure);
        }
        Ok(())
    }

    /// Waits until all earlier messages are stored. The storage thread reports its own failures.
    pub async fn flush(&self) {
        let (flushed, flush) = oneshot::channel();
        let _ = self.out.send(Message::Flush(flushed)).await;
        let _ = flush.await;
    }

    async fn note(&self, entry: Entry) -> Result<(), Failure> {
        self.out.send(Message::Note(entry)).await.map_err(|_| Error::Cancelled.into())
    }
}

/// Brings the devices into a known state: at the start, after a pause, and after a failure.
pub(super) async fn prepare(controller: &mut BenchController<'_>, plan: &Plan) -> Result<(), Failure> {
    controller.prepare(plan.turns()).await?;
    if !plan.turns() {
        compare_analyser(controller).await?;
    }
    Ok(())
}

/// Difference between two angles of the analyser in degrees. A whole turn does not change it.
fn apart_deg(a: f64, b: f64) -> f64 {
    ((a - b + 180.0).rem_euclid(360.0) - 180.0).abs()
}

/// Records the angle of an analyser that the plan does not rotate, or compares it with the angle at earlier frames. A
/// person is asked to rotate it back; a stage is not moved, because such a plan must not move it.
async fn compare_analyser(controller: &mut BenchController<'_>) -> DeviceResult<()> {
    let Some(fixed_analyser_deg) = controller.fixed_analyser_deg else {
        // A plan that does not need the stage must not fail if the stage cannot report its angle.
        controller.fixed_analyser_deg = controller.position().await.ok().filter(|at| at.is_finite());
        return Ok(());
    };
    let stage = controller.limits().stage.clone();
    let tolerance = stage.tolerance_deg.min(FIXED_TOLERANCE_DEG);
    let analyser_deg = match controller.position().await {
        Ok(at) if apart_deg(at, fixed_analyser_deg) <= tolerance => return Ok(()),
        _ if stage.by_hand => return controller.turn(fixed_analyser_deg).await,
        other => other?,
    };
    let expected = format!("{fixed_analyser_deg:.3}° within {tolerance}°, as in the frames so far");
    Err(DeviceError::new(&stage.id, "stand where the analyser stood", expected, format!("{analyser_deg:.3}°"))
        .remedy(format!("turn the analyser back to {fixed_analyser_deg:.3}°, then resume the session")))
}

/// Sets the state of the group and captures its frames in sequence.
async fn capture_group(
    controller: &mut BenchController<'_>,
    watch: &Watch,
    plan: &Plan,
    exposure: Duration,
    out: &Sender<Message>,
    group: &[Step],
    first: usize,
) -> Result<(), Failure> {
    let state = &group[0].state;
    controller.expose(state.exposure(exposure), plan.camera.gain).await?;
    controller.cover(state.covered).await?;
    controller.show(state.pattern).await?;
    if let Some(angle) = state.analyser_deg {
        controller.turn(angle).await?;
    }
    if state.flash {
        controller.switch(true).await?;
    }
    let mut waiting = vec![];
    for (i, step) in group.iter().enumerate() {
        let shot = capture_frame(controller, plan, step, first + i).await?;
        watch.check().await?;
        waiting.push(shot);
        // With the flash on, capture does not wait for a slow disk.
        if !state.flash {
            send(out, &mut waiting).await?;
        }
    }
    controller.still_lit(state.flash).await?;
    if state.flash {
        controller.switch(false).await?;
        send(out, &mut waiting).await?;
    }
    Ok(())
}

async fn send(out: &Sender<Message>, shots: &mut Vec<Shot>) -> Result<(), Failure> {
    for shot in shots.drain(..) {
        out.send(Message::Shot(shot)).await.map_err(|_| Error::Cancelled)?;
    }
    Ok(())
}

/// Captures a step's frame (several if the plan averages), with evidence of freshness.
async fn capture_frame(
    controller: &mut BenchController<'_>,
    plan: &Plan,
    step: &Step,
    index: usize,
) -> Result<Shot, Failure> {
    let (mut frame, dropped) = controller.fresh().await?;
    let mut sum = Averaging::new(frame.width, &frame.codes);
    for _ in 1..plan.camera.average {
        frame = controller.next_frame(controller.freshness()).await?;
        sum.add(&frame.codes);
    }
    let analyser_deg = match step.state.analyser_deg {
        Some(_) => Some(controller.position().await?),
        None => controller.fixed_analyser_deg,
    };
    let (freshness, controls) = (controller.freshness(), controller.controls());
    let evidence = Commit {
        file: step.file.clone(),
        sequence: frame.stamp.sequence,
        timestamp_ns: frame.stamp.timestamp.as_nanos() as u64,
        steady_since_ns: freshness.steady_since.as_nanos() as u64,
        first_sequence: freshness.first_sequence,
        exposure_ns: controls.map_or(0, |c| c.exposure.as_nanos() as u64),
        gain: controls.map_or(0.0, |c| c.gain),
        analyser_deg,
        dropped,
        ..Commit::default()
    };
    Ok(Shot { index, sum, evidence })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_turns_do_not_set_angles_apart() {
        for (a, b, apart) in [(370.0, 10.0, 0.0), (-5.0, 355.0, 0.0), (359.0, 1.0, 2.0), (10.0, 190.0, 180.0)] {
            assert!((apart_deg(a, b) - apart).abs() < 1e-9 && (apart_deg(b, a) - apart).abs() < 1e-9, "{a} {b}");
        }
    }
}
