//! Takes a plan's frames: brings the bench into each state, takes what is fresh, hands it on.

use super::hands::Hands;
use super::series::Decision;
use super::state::{Control, Input, State};
use super::store::{Message, Shot};
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

/// A step that goes wrong in a way that may pass is tried this often in all.
const ATTEMPTS: u32 = 3;

/// An analyser within this angle of where it stood was not moved: stages repeat an angle to some hundredths of a degree,
/// and 0.1° changes the light behind the analyser by less than 0.4 % of its mean.
const UNMOVED_DEG: f64 = 0.1;

/// How a series goes on, as it is decided.
pub type Decisions = UnboundedReceiver<nacre_base::Result<Decision>>;

/// One run through a plan.
pub struct Taker<'a> {
    /// The devices.
    pub hands: Hands<'a>,
    /// What must hold meanwhile.
    pub watch: &'a Watch,
    /// Who steers.
    pub control: &'a Control,
    /// What is to be done.
    pub plan: &'a Plan,
    /// Exposure of steps that name none.
    pub exposure: Duration,
    /// Where frames and notes go.
    pub out: Sender<Message>,
    /// Time spent in pauses, on the clock on the wall.
    pub paused: Duration,
    /// The devices are in a known state.
    pub prepared: bool,
}

/// Runs `work` until it ends, an interlock opens or somebody aborts, whichever comes first.
pub async fn guarded<T>(
    watch: &Watch,
    control: &Control,
    work: impl Future<Output = Result<T, Failure>>,
) -> Result<T, Failure> {
    // Nothing moves before the interlocks are known to hold.
    watch.check().await?;
    tokio::select! {
        biased;
        _ = control.until(|s| s == State::Aborting) => Err(Error::Cancelled.into()),
        error = watch.broken() => Err(error.into()),
        result = work => result,
    }
}

impl Taker<'_> {
    /// Takes all groups of which a frame is missing. The light is off afterwards, come what may.
    ///
    /// # Errors
    /// A device's or interlock's, with the step it belongs to; `Cancelled` when somebody stopped the run; `Cancelled` also
    /// when frames cannot be stored any more, which the other end knows more about.
    ///
    /// Then, for a series that goes on until enough is known, `further` has what was added so far, and where to learn how it
    /// goes on.
    pub async fn take_all(
        &mut self,
        steps: &[Step],
        missing: &[bool],
        further: Option<(Vec<Added>, &mut Decisions)>,
    ) -> Result<(), Failure> {
        let mut result = self.take_known(steps, missing).await;
        if let Some((chosen, decisions)) = further.filter(|_| result.is_ok()) {
            result = self.take_further(chosen, decisions).await;
        }
        let dark = self.hands.dark().await;
        if dark.is_ok() {
            self.control.set_dark();
        }
        result.and(dark.map_err(Failure::from))
    }

    async fn take_known(&mut self, steps: &[Step], missing: &[bool]) -> Result<(), Failure> {
        let mut first = 0;
        for group in groups(steps) {
            if missing[first] {
                self.go_on().await?;
                self.patiently(group, first).await?;
            }
            first += group.len();
        }
        Ok(())
    }

    /// Takes what is decided until the series is to end.
    async fn take_further(&mut self, mut chosen: Vec<Added>, decisions: &mut Decisions) -> Result<(), Failure> {
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
                    let known = self.plan.steps_with(&chosen).len();
                    // The journal has it before any of its frames, so that a resumed session takes the same.
                    self.note(Entry::Chosen { added, sigma_deg, undecided }).await?;
                    chosen.push(added);
                    let steps = self.plan.steps_with(&chosen);
                    for i in known..steps.len() {
                        self.go_on().await?;
                        self.patiently(&steps[i..=i], i).await?;
                    }
                }
                Decision::End(end) => return self.note(Entry::Ended(end)).await,
            }
        }
    }

    /// Waits while the run is paused; `Cancelled` when it is to stop.
    async fn go_on(&mut self) -> Result<(), Failure> {
        loop {
            match self.control.state() {
                State::Running => return Ok(()),
                State::Pausing => {
                    let begun = Instant::now();
                    self.hands.dark().await?;
                    self.hands.stopwatch.pause();
                    self.prepared = false;
                    // A paused session has stored all frames that were taken.
                    self.flush().await;
                    // Before the event of the pause, so that a client that hears of it sees the state `paused`. A wish that came
                    // meanwhile is seen in the next turn of the loop.
                    let _ = self.control.send(Input::Settled);
                    self.note(Entry::Paused).await?;
                    self.flush().await;
                    self.control.until(|s| s != State::Paused).await;
                    self.watch.begin_again().await;
                    self.paused += begun.elapsed();
                }
                State::Resuming => {
                    guarded(self.watch, self.control, prepare(&mut self.hands, self.plan)).await?;
                    self.prepared = true;
                    let _ = self.control.send(Input::Settled);
                }
                _ => return Err(Error::Cancelled.into()),
            }
        }
    }

    /// Takes one group, again if what went wrong may pass.
    async fn patiently(&mut self, group: &[Step], first: usize) -> Result<(), Failure> {
        let mut first_failure = None;
        for attempt in 1.. {
            let work = async {
                if !self.prepared {
                    prepare(&mut self.hands, self.plan).await?;
                }
                take(&mut self.hands, self.watch, self.plan, self.exposure, &self.out, group, first).await
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
                // What went wrong first says more than what followed from it.
                return Err(first_failure.unwrap_or(failure).at(&format!("{step} (tried {ATTEMPTS} times)")));
            }
            self.prepared = false;
            // The preparation of the next attempt switches the light off too, and says so if it cannot.
            let _ = self.hands.dark().await;
            self.note(Entry::Retried { reason: format!("{step}: {failure}") }).await?;
            first_failure.get_or_insert(failure);
        }
        Ok(())
    }

    /// Waits until everything so far is stored. Whoever stores may have given up, and says why itself.
    pub async fn flush(&self) {
        let (flushed, flush) = oneshot::channel();
        let _ = self.out.send(Message::Flush(flushed)).await;
        let _ = flush.await;
    }

    async fn note(&self, entry: Entry) -> Result<(), Failure> {
        self.out.send(Message::Note(entry)).await.map_err(|_| Error::Cancelled.into())
    }
}

/// Brings the devices into a known state: at first, after a pause, and after a failure.
pub(super) async fn prepare(hands: &mut Hands<'_>, plan: &Plan) -> Result<(), Failure> {
    hands.prepare(plan.turns()).await?;
    if !plan.turns() {
        compare_analyser(hands).await?;
    }
    Ok(())
}

/// Learns where an analyser stands that the plan does not turn, or compares it with where it stood at the frames before.
/// A person is asked to turn it back; a stage is not moved, since such a plan leaves it alone.
async fn compare_analyser(hands: &mut Hands<'_>) -> DeviceResult<()> {
    let Some(stood) = hands.stood else {
        // A stage that cannot say it is no reason to refuse a plan that does not need it.
        hands.stood = hands.position().await.ok().filter(|at| at.is_finite());
        return Ok(());
    };
    let stage = hands.limits().stage.clone();
    let tolerance = stage.tolerance_deg.min(UNMOVED_DEG);
    let stands = match hands.position().await {
        Ok(at) if (at - stood).abs() <= tolerance => return Ok(()),
        _ if stage.by_hand => return hands.turn(stood).await,
        other => other?,
    };
    let expected = format!("{stood:.3}° within {tolerance}°, as in the frames so far");
    Err(DeviceError::new(&stage.id, "stand where the analyser stood", expected, format!("{stands:.3}°"))
        .remedy(format!("turn the analyser back to {stood:.3}°, then resume the session")))
}

/// Brings the bench into the group's state and takes its frames, one after the other.
async fn take(
    hands: &mut Hands<'_>,
    watch: &Watch,
    plan: &Plan,
    exposure: Duration,
    out: &Sender<Message>,
    group: &[Step],
    first: usize,
) -> Result<(), Failure> {
    let state = &group[0].state;
    hands.expose(state.exposure(exposure), plan.camera.gain).await?;
    hands.cover(state.covered).await?;
    hands.show(state.pattern).await?;
    if let Some(angle) = state.analyser_deg {
        hands.turn(angle).await?;
    }
    if state.flash {
        hands.switch(true).await?;
    }
    let mut waiting = vec![];
    for (i, step) in group.iter().enumerate() {
        let shot = shoot(hands, plan, step, first + i).await?;
        watch.check().await?;
        waiting.push(shot);
        // Under the flash nothing waits for a slow disk.
        if !state.flash {
            send(out, &mut waiting).await?;
        }
    }
    hands.still_lit(state.flash).await?;
    if state.flash {
        hands.switch(false).await?;
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

/// A step's frame, several when the plan averages, with the evidence that it is fresh.
async fn shoot(hands: &mut Hands<'_>, plan: &Plan, step: &Step, index: usize) -> Result<Shot, Failure> {
    let (mut frame, dropped) = hands.fresh().await?;
    let mut sum = Averaging::new(frame.width, &frame.codes);
    for _ in 1..plan.camera.average {
        frame = hands.next_frame(hands.freshness()).await?;
        sum.add(&frame.codes);
    }
    let analyser_deg = match step.state.analyser_deg {
        Some(_) => Some(hands.position().await?),
        None => hands.stood,
    };
    let (freshness, controls) = (hands.freshness(), hands.controls());
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
