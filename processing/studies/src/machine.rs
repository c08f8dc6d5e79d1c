//! Description of the computer on which a chart was measured.

use serde::{Deserialize, Serialize};

/// The computer. Times of different computers must not be mixed in one chart.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Machine {
    /// Processor model, as reported by the system.
    pub cpu: String,
    /// Number of threads available to the program.
    pub cores: usize,
    /// Operating system and architecture.
    pub system: String,
}

impl Machine {
    /// Describes this computer.
    pub fn this() -> Self {
        let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        Self {
            cpu: model(&text).unwrap_or("unknown processor").to_owned(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            system: format!("{} {}", std::env::consts::OS, std::env::consts::ARCH),
        }
    }
}

/// Model name of the first processor in Linux's `/proc/cpuinfo`; ARM kernels do not report one.
fn model(text: &str) -> Option<&str> {
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_model_is_read() {
        assert_eq!(model("processor\t: 0\nmodel name\t: Some CPU @ 2 GHz\nflags\t: a b"), Some("Some CPU @ 2 GHz"));
        assert_eq!(model("CPU part : 0xd08"), None);
        assert!(Machine::this().cores > 0);
    }
}
