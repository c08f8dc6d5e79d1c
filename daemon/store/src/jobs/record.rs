//! State machine of a job: the allowed changes of state. It does not use the database.

use super::{Job, JobState, MAX_ATTEMPTS, MAX_CUT_OFF, Refusal};
use nacre_capture::Failure;

/// A job while a transaction changes it.
pub(super) struct Record {
    pub job: Job,
    /// Cancellation request for a running job; stored, so that the job does not restart after a kill.
    pub cancel: bool,
    /// Lines to append to the log.
    pub lines: Vec<String>,
    /// Whether the change delivers the job to the worker.
    pub deliver: bool,
}

/// End of an attempt.
pub(super) struct End {
    /// Result of the work, or panic of its thread.
    pub result: Result<(), Failed>,
    /// Whether the queue is shutting down.
    pub stopping: bool,
    /// Progress at the end, 0 to 1.
    pub progress: f64,
}

/// Cause of a failed attempt.
pub(super) enum Failed {
    /// It stopped as requested.
    Cancelled,
    /// The input cannot be used: another attempt would fail as well.
    Input(String),
    /// Any other error.
    Other(String),
}

impl From<Failure> for Failed {
    fn from(failure: Failure) -> Self {
        match failure.exit_code() {
            130 => Self::Cancelled,
            2 => Self::Input(failure.to_string()),
            _ => Self::Other(failure.to_string()),
        }
    }
}

impl Record {
    pub fn new(job: Job, cancel: bool) -> Self {
        Self { job, cancel, lines: Vec::new(), deliver: false }
    }

    /// A new job, queued.
    pub fn submitted(job: Job) -> Self {
        Self { job, cancel: false, lines: vec!["queued".into()], deliver: true }
    }

    /// The worker begins a queued job. A delivery of a job in any other state is obsolete and changes nothing.
    pub fn begin(&mut self) -> Result<(), Refusal> {
        if self.job.state != JobState::Queued {
            return Err(self.refuse("begun"));
        }
        self.job.state = JobState::Running;
        self.job.attempts += 1;
        self.start_over();
        self.lines.push(format!("attempt {} of {MAX_ATTEMPTS} begins", self.job.attempts));
        Ok(())
    }

    /// The running job enters a stage.
    pub fn stage(&mut self, name: &str) -> Result<(), Refusal> {
        self.job.stage = name.into();
        self.lines.push(format!("stage: {name}"));
        Ok(())
    }

    /// Ends the attempt.
    pub fn end(&mut self, end: &End) -> Result<(), Refusal> {
        self.job.progress = end.progress;
        match &end.result {
            Ok(()) => {
                self.job.progress = 1.0;
                self.turn(JobState::Done, "done");
            }
            Err(failed) if self.cancel => {
                if let Failed::Input(error) | Failed::Other(error) = failed {
                    self.error(error);
                }
                self.turn(JobState::Cancelled, "cancelled");
            }
            Err(Failed::Cancelled) if end.stopping => {
                self.job.attempts = self.job.attempts.saturating_sub(1);
                self.start_over();
                self.turn(
                    JobState::Queued,
                    "put back into the queue, as the service ends; this attempt does not count",
                );
            }
            Err(Failed::Input(error)) => {
                self.error(error);
                self.turn(JobState::Failed, "failed: another attempt would end the same way");
            }
            Err(Failed::Other(error)) => self.again(error),
            Err(Failed::Cancelled) => self.again("stopped without a request"),
        }
        Ok(())
    }

    /// The process that ran the job ended without a result.
    pub fn cut_off(&mut self) -> Result<(), Refusal> {
        if self.cancel {
            self.turn(JobState::Cancelled, "cancelled");
        } else if self.job.attempts < MAX_CUT_OFF {
            self.again("the service was killed, or crashed, during this attempt");
        } else {
            self.error(
                "the service was killed, or crashed, during this attempt too; retry the job if it was not to blame",
            );
            self.turn(JobState::Failed, "failed: it is not tried at every start of the service");
        }
        Ok(())
    }

    /// Cancels the job.
    pub fn cancel(&mut self) -> Result<(), Refusal> {
        match self.job.state {
            JobState::Queued => self.turn(JobState::Cancelled, "cancelled before it began"),
            JobState::Running if self.cancel => {}
            JobState::Running => {
                self.cancel = true;
                self.lines.push("asked to stop".into());
            }
            _ => return Err(self.refuse("cancelled")),
        }
        Ok(())
    }

    /// Queues an unsuccessful job again.
    pub fn retry(&mut self) -> Result<(), Refusal> {
        if !matches!(self.job.state, JobState::Failed | JobState::Cancelled | JobState::SetAside) {
            return Err(self.refuse("retried"));
        }
        self.job.attempts = 0;
        self.start_over();
        self.turn(JobState::Queued, "queued again");
        self.deliver = true;
        Ok(())
    }

    /// Starts another attempt, if one is left.
    fn again(&mut self, error: &str) {
        self.error(error);
        if self.job.attempts < MAX_ATTEMPTS {
            self.turn(JobState::Queued, "queued for another attempt");
            self.deliver = true;
        } else {
            self.turn(JobState::SetAside, "set aside: no attempt is left");
        }
    }

    fn error(&mut self, error: &str) {
        self.job.error = Some(error.into());
        self.lines.push(format!("error: {error}"));
    }

    fn turn(&mut self, state: JobState, line: &str) {
        self.job.state = state;
        self.cancel = false;
        self.lines.push(line.into());
    }

    fn start_over(&mut self) {
        self.job.progress = 0.0;
        self.job.stage.clear();
        self.job.error = None;
        self.cancel = false;
    }

    fn refuse(&self, wish: &'static str) -> Refusal {
        Refusal::State { id: self.job.id.clone(), state: self.job.state, wish }
    }
}
