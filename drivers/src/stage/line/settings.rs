//! Configuration of a stage with a text protocol.

use super::pattern::{Pattern, Template};
use crate::stage::check;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A stage with a text protocol, which is described here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Serial port, such as /dev/ttyUSB0 or a link in /dev/serial/by-id.
    pub port: PathBuf,
    /// Name of the stage.
    #[serde(default = "name")]
    pub name: String,
    /// Baud rate.
    #[serde(default = "baud")]
    pub baud: u32,
    /// Terminator of each sent line.
    #[serde(default = "terminator")]
    pub terminator: String,
    /// Finds the zero. Without it the stage's angles are taken as absolute.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub home: Option<Exchange>,
    /// Moves to `{angle}` or `{units}`.
    #[serde(rename = "move")]
    pub go: Exchange,
    /// Queries the position, answered with `{angle}` or `{units}`.
    pub position: Exchange,
    /// Queries whether the stage stands; the reply is that of a stationary stage. Without it, moves and homing must be
    /// answered at their end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub poll: Option<Exchange>,
    /// Stops a movement.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub halt: Option<Exchange>,
    /// Patterns of error replies, such as `ERR{any}`.
    #[serde(default)]
    pub errors: Vec<String>,
    /// The stage's own units per degree, for `{units}`.
    #[serde(default = "one")]
    pub units_per_deg: f64,
    /// Times, angles and limits of the stage.
    #[serde(default)]
    pub motion: Motion,
}

/// A sent line, and the pattern of its reply. Placeholders are `{angle}`, `{units}`, `{number}` and `{any}`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Exchange {
    /// Sent line; `{angle:.3}` is the target with three decimals.
    pub send: String,
    /// Pattern of the reply.
    pub reply: String,
}

/// Times and angles of a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Motion {
    /// Maximum time for an answer, in ms.
    pub answer_ms: u64,
    /// Maximum time of a movement, homing included, in ms.
    pub move_ms: u64,
    /// Settling time after a move, in ms.
    pub settling_ms: u64,
    /// Speed in degrees per second, for time estimates.
    pub speed_deg_s: f64,
    /// Largest accepted difference between reported and requested angle, in degrees.
    pub tolerance_deg: f64,
    /// Lowest and highest angle of the axis in degrees.
    pub limits_deg: [f64; 2],
}

impl Default for Motion {
    fn default() -> Self {
        Self {
            answer_ms: 1000,
            move_ms: 60_000,
            settling_ms: 200,
            speed_deg_s: 30.0,
            tolerance_deg: 0.1,
            limits_deg: [0.0, 360.0],
        }
    }
}

fn name() -> String {
    "stage".into()
}

fn baud() -> u32 {
    9600
}

fn terminator() -> String {
    "\r\n".into()
}

fn one() -> f64 {
    1.0
}

/// A parsed exchange.
pub(super) struct Command {
    pub(super) send: Template,
    pub(super) reply: Pattern,
}

/// All exchanges of a stage.
pub(super) struct Phrases {
    pub(super) home: Option<Command>,
    pub(super) go: Command,
    pub(super) position: Command,
    pub(super) poll: Option<Command>,
    pub(super) halt: Option<Command>,
    pub(super) errors: Vec<Pattern>,
}

impl Settings {
    /// Parses all templates and patterns, and checks the other keys.
    ///
    /// # Errors
    /// The invalid key and its defect.
    pub(super) fn read(&self) -> Result<Phrases, String> {
        check::port(&self.port)?;
        check::number("units_per_deg", self.units_per_deg.abs(), 1e-6, 1e9)?;
        if self.terminator.is_empty() || self.terminator.len() > 4 {
            return Err("terminator must have 1 to 4 bytes, such as \"\\r\\n\"".into());
        }
        self.motion.check()?;
        let optional = |key, exchange: &Option<Exchange>| exchange.as_ref().map(|e| command(key, e, false)).transpose();
        let position = command("position", &self.position, false)?;
        if !position.reply.has_angle() {
            return Err("position.reply needs {angle} or {units}".into());
        }
        let error = |text: &String| Pattern::new(text).map_err(|e| format!("errors: {e}"));
        Ok(Phrases {
            home: optional("home", &self.home)?,
            go: command("move", &self.go, true)?,
            position,
            poll: optional("poll", &self.poll)?,
            halt: optional("halt", &self.halt)?,
            errors: self.errors.iter().map(error).collect::<Result<_, _>>()?,
        })
    }
}

fn command(key: &str, exchange: &Exchange, target: bool) -> Result<Command, String> {
    let send = Template::new(&exchange.send).map_err(|e| format!("{key}.send: {e}"))?;
    let reply = Pattern::new(&exchange.reply).map_err(|e| format!("{key}.reply: {e}"))?;
    match send.has_target() {
        has if has == target => Ok(Command { send, reply }),
        true => Err(format!("{key}.send: only a move has a target")),
        false => Err(format!("{key}.send needs {{angle}} or {{units}}")),
    }
}

impl Motion {
    fn check(&self) -> Result<(), String> {
        check::milliseconds("motion.answer_ms", self.answer_ms, 1)?;
        check::milliseconds("motion.move_ms", self.move_ms, 1)?;
        check::milliseconds("motion.settling_ms", self.settling_ms, 0)?;
        check::number("motion.speed_deg_s", self.speed_deg_s, 0.01, 1e4)?;
        check::number("motion.tolerance_deg", self.tolerance_deg, 1e-3, 5.0)?;
        check::limits(self.limits_deg)
    }
}
