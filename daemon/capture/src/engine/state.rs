//! State machine of a run.

use serde::{Deserialize, Serialize};
use tokio::sync::watch;

/// State of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// Not started, or stopped; missing frames can still be captured.
    Idle,
    /// Capturing frames.
    Running,
    /// Will pause after the frames in progress.
    Pausing,
    /// Waiting, with the light off.
    Paused,
    /// Preparing the devices to continue.
    Resuming,
    /// Will stop after the frames in progress.
    Stopping,
    /// Stopping at once.
    Aborting,
    /// All frames are there.
    Finished,
    /// Ended by an error.
    Failed,
}

/// Inputs of the state machine: user requests, and reports of the engine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// Request: begin.
    Start,
    /// Request: pause after the frames in progress.
    Pause,
    /// Request: continue.
    Resume,
    /// Request: stop after the frames in progress.
    Stop,
    /// Request: stop at once.
    Abort,
    /// Engine: the requested state is reached.
    Settled,
    /// Engine: all frames are captured.
    Done,
    /// Engine: an error occurred.
    Fault,
}

/// All valid transitions; any other is rejected.
pub const TABLE: &[(State, Input, State)] = {
    use {Input as I, State as S};
    &[
        (S::Idle, I::Start, S::Running),
        (S::Running, I::Pause, S::Pausing),
        (S::Pausing, I::Settled, S::Paused),
        (S::Pausing, I::Resume, S::Running),
        (S::Paused, I::Resume, S::Resuming),
        (S::Resuming, I::Settled, S::Running),
        (S::Resuming, I::Pause, S::Pausing),
        (S::Running, I::Stop, S::Stopping),
        (S::Pausing, I::Stop, S::Stopping),
        (S::Paused, I::Stop, S::Stopping),
        (S::Resuming, I::Stop, S::Stopping),
        (S::Stopping, I::Settled, S::Idle),
        (S::Running, I::Abort, S::Aborting),
        (S::Pausing, I::Abort, S::Aborting),
        (S::Paused, I::Abort, S::Aborting),
        (S::Resuming, I::Abort, S::Aborting),
        (S::Stopping, I::Abort, S::Aborting),
        (S::Aborting, I::Settled, S::Idle),
        (S::Running, I::Done, S::Finished),
        (S::Pausing, I::Done, S::Finished),
        (S::Stopping, I::Done, S::Finished),
        (S::Running, I::Fault, S::Failed),
        (S::Pausing, I::Fault, S::Failed),
        (S::Paused, I::Fault, S::Failed),
        (S::Resuming, I::Fault, S::Failed),
        (S::Stopping, I::Fault, S::Failed),
        (S::Aborting, I::Fault, S::Failed),
    ]
};

/// State of a run, for observation and control.
pub struct Control {
    state: watch::Sender<State>,
    dark: watch::Sender<bool>,
}

impl Default for Control {
    fn default() -> Self {
        Self { state: watch::Sender::new(State::Idle), dark: watch::Sender::new(false) }
    }
}

impl Control {
    /// Present state.
    pub fn state(&self) -> State {
        *self.state.borrow()
    }

    /// Performs the transition for an input.
    ///
    /// # Errors
    /// The unchanged state, if the table has no such transition.
    pub fn send(&self, input: Input) -> Result<State, State> {
        let mut outcome = Err(self.state());
        self.state.send_if_modified(|state| {
            let to = TABLE.iter().find(|(from, by, _)| (from, by) == (state, &input)).map(|t| t.2);
            outcome = to.ok_or(*state);
            to.is_some_and(|to| std::mem::replace(state, to) != to)
        });
        outcome
    }

    /// Called by the engine when the light is finally off.
    pub fn set_dark(&self) {
        self.dark.send_replace(true);
    }

    /// Waits until the run's light is finally off.
    pub async fn is_dark(&self) {
        // The sender lives as long as `self`, so this cannot fail.
        let _ = self.dark.subscribe().wait_for(|dark| *dark).await;
    }

    /// Waits for a state that satisfies `wanted`; returns it.
    pub async fn until(&self, wanted: impl Fn(State) -> bool) -> State {
        let mut states = self.state.subscribe();
        // The sender lives as long as `self`, so this cannot fail.
        states.wait_for(|s| wanted(*s)).await.map_or(State::Failed, |s| *s)
    }

    /// Stream of state changes.
    pub fn subscribe(&self) -> watch::Receiver<State> {
        self.state.subscribe()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_a_function_and_reaches_every_state() {
        for (i, a) in TABLE.iter().enumerate() {
            assert!(TABLE[..i].iter().all(|b| (a.0, a.1) != (b.0, b.1)), "{a:?} is ambiguous");
        }
        let mut reached = vec![State::Idle];
        for _ in 0..TABLE.len() {
            let next = TABLE.iter().filter(|t| reached.contains(&t.0)).map(|t| t.2);
            reached = next.chain(reached.clone()).collect();
        }
        for t in TABLE {
            assert!(reached.contains(&t.0) && reached.contains(&t.2));
        }
        // A run can be aborted and can fail in every state except its final ones.
        for state in [State::Running, State::Pausing, State::Paused, State::Resuming, State::Stopping] {
            assert!([Input::Abort, Input::Fault].iter().all(|i| TABLE.iter().any(|t| (t.0, t.1) == (state, *i))));
        }
    }

    #[test]
    fn refused_inputs_change_nothing() {
        let control = Control::default();
        assert_eq!(control.send(Input::Resume), Err(State::Idle));
        assert_eq!(control.send(Input::Start), Ok(State::Running));
        assert_eq!(control.send(Input::Pause), Ok(State::Pausing));
        assert_eq!(control.send(Input::Start), Err(State::Pausing));
        assert_eq!(control.state(), State::Pausing);
    }
}
