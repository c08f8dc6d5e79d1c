//! Running an operation: on a thread, while the calling one reports progress and waits for Ctrl-C.

use crate::{raised, ready};
use nacre_base::progress::Progress;
use nacre_base::{Result, numeric};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use serde_json::json;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Interval between checks for Ctrl-C and calls of the progress callback.
const TICK: Duration = Duration::from_millis(50);

/// State of a computation, shared with its thread.
#[derive(Default)]
struct Shared {
    cancelled: AtomicBool,
    done: AtomicU64,
    stage: Mutex<(String, u64)>,
}

impl Progress for Shared {
    fn stage(&self, name: &str, steps: u64) {
        *self.stage.lock().unwrap_or_else(PoisonError::into_inner) = (name.to_owned(), steps);
        self.done.store(0, Ordering::Relaxed);
    }

    fn step(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }

    fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

impl Shared {
    fn now(&self) -> (String, u64, u64) {
        let (name, steps) = self.stage.lock().unwrap_or_else(PoisonError::into_inner).clone();
        (name, self.done.load(Ordering::Relaxed).min(steps), steps)
    }
}

/// Runs an operation from `input` into the new folder `out`. Returns JSON with `report`, `summary`, `warnings` and
/// `missed`, the reason why the result exceeds the requested error.
///
/// `progress(stage, done, steps)` is called on the calling thread while the state changes. An exception in it, or
/// Ctrl-C, cancels the computation; nothing is then written.
#[pyfunction]
#[pyo3(signature = (name, input, out, options, overwrite, progress=None))]
pub fn run(
    py: Python<'_>,
    name: &str,
    input: PathBuf,
    out: PathBuf,
    options: &str,
    overwrite: bool,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let ready = ready(name, options)?;
    let shared = Arc::new(Shared::default());
    let (sender, receiver) = channel();
    let receiver = Mutex::new(receiver);
    let own = shared.clone();
    let worker = std::thread::spawn(move || {
        // On this thread and those of the computation; the interpreter's own arithmetic stays as it is.
        numeric::flush_subnormals();
        let text = || -> Result<String> {
            let done = ready.perform(&input, &out, overwrite, &*own)?;
            let (summary, warnings, missed) = (done.summary.clone(), done.warnings.clone(), done.missed.clone());
            Ok(json!({ "report": done, "summary": summary, "warnings": warnings, "missed": missed }).to_string())
        };
        // The receiver is there until the thread ends.
        let _ = sender.send(text());
    });
    let mut problem = None;
    let mut shown = None;
    let result = loop {
        match py.detach(|| receiver.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(TICK)) {
            Ok(result) => break result,
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err("the computation ended by an internal error; report this"));
            }
        }
        if problem.is_some() {
            continue;
        }
        let now = shared.now();
        let changed = !now.0.is_empty() && shown.as_ref() != Some(&now);
        let told = py.check_signals().and_then(|()| match &progress {
            Some(progress) if changed => progress.call1(py, now.clone()).map(|_| ()),
            _ => Ok(()),
        });
        shown = Some(now);
        if let Err(error) = told {
            shared.cancelled.store(true, Ordering::Relaxed);
            problem = Some(error);
        }
    };
    py.detach(|| worker.join()).map_err(|_| PyRuntimeError::new_err("the computation failed; report this"))?;
    match problem {
        Some(error) => Err(error),
        None => result.map_err(raised),
    }
}
