//! Terminal output: text or JSON results on standard output, progress and errors on standard error.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use nacre_base::Error;
use nacre_base::estimate::{Estimate, Running, Work};
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_capture::engine::Observer;
use nacre_capture::session::SoFar;
use nacre_service::problem::Problem;
use serde::Serialize;
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A progress bar appears only if a stage takes longer than this.
const PATIENCE: Duration = Duration::from_secs(1);

/// Output of one command, and the user's requests to stop it.
pub struct Console {
    json: bool,
    /// With `--estimate`, operations only predict time, memory and disk space.
    only_estimate: bool,
    /// Number of interrupts received.
    interrupted: Arc<AtomicU32>,
    stage: Mutex<Stage>,
    /// The running operation, once it has stated its prediction.
    running: Mutex<Option<Running>>,
    /// Set once a result has been printed. A missed bound then only sets the exit code, without a second JSON document.
    answered: AtomicBool,
}

struct Stage {
    name: String,
    steps: u64,
    done: u64,
    begun: Instant,
    /// Hidden until the stage has lasted for `PATIENCE`.
    bar: ProgressBar,
}

impl Console {
    /// Installs the handler of Ctrl-C and SIGTERM, so that a command can clean up.
    pub fn new(json: bool, only_estimate: bool) -> Self {
        let interrupted = Arc::new(AtomicU32::new(0));
        let count = interrupted.clone();
        // Fails only if a handler is already set; the system's default then ends the program.
        let _ = ctrlc::set_handler(move || {
            count.fetch_add(1, Ordering::Relaxed);
        });
        let stage = Mutex::new(Stage::new("", 0));
        Self { json, only_estimate, interrupted, stage, running: Mutex::default(), answered: AtomicBool::new(false) }
    }

    /// Prints the operation's prediction if `--estimate` was given; returns whether it did.
    pub fn estimated(&self) -> bool {
        let running = self.running.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(estimate) = running.filter(|_| self.only_estimate).map(|running| running.estimate()) else {
            return false;
        };
        self.result(&needs(&estimate), &estimate);
        true
    }

    /// Number of Ctrl-C presses and SIGTERM signals.
    pub fn interrupted(&self) -> Arc<AtomicU32> {
        self.interrupted.clone()
    }

    /// Prints the command's result: `text` for a person, or `value` as JSON.
    pub fn result(&self, text: &str, value: &impl Serialize) {
        self.finish_stage();
        let running = self.running.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(running) = running {
            running.complete();
        }
        let json = || serde_json::to_string_pretty(value).unwrap_or_default();
        self.answered.store(true, Ordering::Relaxed);
        let line = if self.json { json() } else { text.trim_end().to_owned() };
        // A closed pipe (`| head`) is not a failure of the command.
        let _ = writeln!(std::io::stdout().lock(), "{line}");
    }

    /// Prints a note to standard error.
    pub fn note(&self, text: &str) {
        let stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        stage.bar.suspend(|| {
            let _ = writeln!(std::io::stderr().lock(), "{text}");
        });
    }

    /// Changes the label of the current stage.
    pub fn relabel(&self, name: &str) {
        let mut stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        name.clone_into(&mut stage.name);
        stage.bar.set_message(name.to_owned());
    }

    /// Prints the error of a failed command as text, and also as JSON with `--json`.
    pub fn error(&self, failure: Failure) {
        self.finish_stage();
        self.note(&format!("nacre: {failure}"));
        if self.json && !self.answered.load(Ordering::Relaxed) {
            let (code, text) = (failure.exit_code(), failure.to_string());
            print_problem(&Problem::from(failure).in_full(&text), code);
        }
    }

    fn finish_stage(&self) {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner).bar.finish_and_clear();
    }
}

impl Stage {
    fn new(name: &str, steps: u64) -> Self {
        Self { name: name.to_owned(), steps, done: 0, begun: Instant::now(), bar: ProgressBar::hidden() }
    }

    fn visible_bar(&self) -> ProgressBar {
        let style = ProgressStyle::with_template("{msg:20} {bar:30} {percent:>3} %  {elapsed} gone{prefix}")
            .unwrap_or_else(|_| ProgressStyle::default_bar());
        ProgressBar::with_draw_target(Some(self.steps), ProgressDrawTarget::stderr())
            .with_style(style)
            .with_message(self.name.clone())
            .with_elapsed(self.begun.elapsed())
    }
}

impl Progress for Console {
    fn expect(&self, work: &Work) -> Result<(), Error> {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        // Only the first prediction counts: it covers the whole operation, while parts may state their own.
        running.get_or_insert_with(|| Running::begin(work.clone()));
        if self.only_estimate { Err(Error::Cancelled) } else { Ok(()) }
    }

    fn stage(&self, name: &str, steps: u64) {
        let mut stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        stage.bar.finish_and_clear();
        *stage = Stage::new(name, steps);
    }

    fn step(&self) {
        let mut stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        stage.done += 1;
        if stage.bar.is_hidden() && stage.begun.elapsed() > PATIENCE && std::io::stderr().is_terminal() {
            stage.bar = stage.visible_bar();
        }
        stage.bar.set_position(stage.done);
        if !stage.bar.is_hidden() {
            let running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
            // Remaining time of the stage, used when the operation made no prediction.
            let stage_s = || stage.bar.eta().as_secs_f64();
            let left = running.as_ref().map_or_else(stage_s, Running::remaining_s);
            stage.bar.set_prefix(format!(", about {} left", duration(left)));
        }
    }

    fn cancelled(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed) > 0
    }
}

/// Prints a problem (RFC 9457) with its exit code.
pub fn print_problem(problem: &Problem, exit_code: u8) {
    let mut value = serde_json::to_value(problem).unwrap_or_default();
    if let Some(object) = value.as_object_mut() {
        // The HTTP status is meaningless on a command line.
        object.remove("status");
        object.insert("exit_code".into(), exit_code.into());
    }
    let _ = writeln!(std::io::stdout().lock(), "{}", serde_json::to_string_pretty(&value).unwrap_or_default());
}

/// Time, memory and disk space as text.
fn needs(estimate: &Estimate) -> String {
    let [memory, disk] = [estimate.memory_bytes, estimate.disk_bytes].map(|bytes| bytes as f64 / 1e6);
    format!(
        "time      about {}\nmemory    about {memory:.0} MB\ndisk      about {disk:.1} MB",
        duration(estimate.seconds)
    )
}

/// A duration with about two significant digits.
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 10.0 => format!("{s:.1} s"),
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

impl Observer for Console {
    fn so_far(&self, so_far: &SoFar) {
        self.relabel(&so_far.label());
    }
}
