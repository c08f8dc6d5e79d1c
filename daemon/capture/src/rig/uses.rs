//! Devices required by a command, and the error that names missing ones.

use super::Place;
use crate::setup::BenchSection;
use nacre_base::Error;
use nacre_drivers::camera::CameraDriver;
use nacre_drivers::display::DisplayDriver;
use nacre_drivers::stage::StageDriver;

/// Use of a device by a task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// The device stays closed, and available to other processes.
    Never,
    /// The device is opened if it exists.
    IfThere,
    /// The task fails without the device.
    Always,
}

/// Use of each device of a bench by a task.
#[derive(Clone, Copy, Debug)]
pub struct Uses {
    /// Stage of the analyser.
    pub stage: Use,
    /// The camera.
    pub camera: Use,
    /// The panel.
    pub display: Use,
    /// The flash.
    pub flash: Use,
}

impl Uses {
    /// No device.
    pub const NONE: Self = Self { stage: Use::Never, camera: Use::Never, display: Use::Never, flash: Use::Never };

    /// True if a task may move a device or emit light, which interlocks prevent.
    pub(super) fn moves_or_lights(self) -> bool {
        [self.stage, self.display, self.flash].iter().any(|used| *used != Use::Never)
    }

    /// A session: all devices, and the flash if it exists.
    pub const SESSION: Self =
        Self { stage: Use::Always, camera: Use::Always, display: Use::Always, flash: Use::IfThere };
}

impl Place {
    /// Existence of stage, camera, display and flash: simulated, or configured as devices of this machine.
    pub(super) fn has(&self) -> [bool; 4] {
        let s = &self.section;
        let described = [
            s.stage.as_ref().is_some_and(|s| !matches!(s.driver, StageDriver::Simulated {})),
            s.camera.as_ref().is_some_and(|c| !matches!(c.driver, CameraDriver::Simulated {})),
            s.display.as_ref().is_some_and(|d| !matches!(d.driver, DisplayDriver::Simulated {})),
            s.flash.as_ref().is_some_and(|f| !f.is_simulated()),
        ];
        described.map(|there| there || self.simulated.is_some())
    }

    /// True if there is a panel.
    pub fn has_display(&self) -> bool {
        self.has()[2]
    }

    /// Checks that the configuration has the required devices, before any is opened.
    ///
    /// # Errors
    /// `Input`, naming all missing sections.
    pub fn require(&self, uses: Uses) -> Result<(), Error> {
        let uses = [("stage", uses.stage), ("camera", uses.camera), ("display", uses.display), ("flash", uses.flash)];
        let missing: Vec<&str> =
            uses.iter().zip(self.has()).filter(|((_, u), has)| *u == Use::Always && !has).map(|(u, _)| u.0).collect();
        if missing.is_empty() {
            return Ok(());
        }
        let sections: Vec<String> = missing.iter().map(|what| format!("[bench.{what}]")).collect();
        let remedy = format!(
            "add {} to nacre.toml (`nacre devices` prints drivers), or simulate the bench (--sim)",
            sections.join(" and ")
        );
        Err(Error::input("bench", format!("has no {}", missing.join(" and no ")), remedy))
    }
}

impl BenchSection {
    /// The section without unused devices. Interlocks are used by tasks that move a device or emit light.
    pub fn only(&self, uses: Uses) -> Self {
        Self {
            stage: self.stage.clone().filter(|_| uses.stage != Use::Never),
            camera: self.camera.clone().filter(|_| uses.camera != Use::Never),
            display: self.display.clone().filter(|_| uses.display != Use::Never),
            flash: self.flash.clone().filter(|_| uses.flash != Use::Never),
            interlocks: if uses.moves_or_lights() { self.interlocks.clone() } else { vec![] },
            ..self.clone()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Rig, SimulatedBench, Stop, runtime};
    use super::*;
    use nacre_base::progress::Silent;
    use nacre_drivers::Pattern;
    use nacre_sim::BenchConfig;

    const CAMERA: Uses = Uses { camera: Use::Always, ..Uses::NONE };

    fn place(section: &str, simulated: Option<SimulatedBench>) -> Place {
        Place { simulated, section: toml::from_str(section).unwrap(), page: None }
    }

    #[test]
    fn sections_that_are_missing_are_named_together() {
        let lamp = "flash = { driver = { kind = \"relay\" } }";
        let missing = |section: &str, uses| place(section, None).require(uses).unwrap_err().to_string();
        let error = missing(lamp, Uses::SESSION);
        assert!(error.contains("no stage and no camera and no display"), "{error}");
        assert!(error.contains("[bench.stage] and [bench.camera] and [bench.display]"), "{error}");
        assert!(missing("", Uses { flash: Use::Always, ..Uses::NONE }).contains("[bench.flash]"));
        place(lamp, None).require(Uses { flash: Use::Always, ..Uses::NONE }).unwrap();
        place("", None).require(Uses { flash: Use::IfThere, ..Uses::NONE }).unwrap();
        // A simulated device does not exist without a simulated bench.
        assert!(missing("camera = { driver = { kind = \"simulated\" } }", CAMERA).contains("no camera"));
        place("stage = { driver = { kind = \"hand\" } }", None)
            .require(Uses { stage: Use::Always, ..Uses::NONE })
            .unwrap();
    }

    #[test]
    fn tasks_that_move_or_light_use_interlocks() {
        let door = "interlocks = [{ name = \"door\", driver = { kind = \"gpio\", chip = \"/dev/x\", line = 1 } }]";
        let section = place(door, None).section;
        assert!(section.only(CAMERA).interlocks.is_empty() && section.only(Uses::NONE).interlocks.is_empty());
        for uses in [
            Uses::SESSION,
            Uses { stage: Use::Always, ..Uses::NONE },
            Uses { display: Use::IfThere, ..Uses::NONE },
            Uses { flash: Use::Always, ..Uses::NONE },
        ] {
            assert_eq!(section.only(uses).interlocks.len(), 1, "{uses:?}");
        }
    }

    #[test]
    fn only_devices_that_are_used_are_open() {
        let mut config = BenchConfig::default();
        (config.camera.width, config.camera.height) = (16, 16);
        let runtime = runtime().unwrap();
        let place = Place::here(config);
        let mut rig = Rig::open(&runtime, &place, CAMERA, &Silent, &Stop::default()).ok().unwrap();
        assert_eq!(rig.ids, [rig.devices.camera.describe().id]);
        assert!(rig.devices.flash.is_none());
        runtime.block_on(async {
            assert!(rig.devices.stage.move_to(1.0).await.is_err());
            assert!(rig.devices.display.show(Pattern::Disc { center_mm: [0.0; 2], diameter_mm: 9.0 }).await.is_err());
            // A panel that is not open has no light to switch off.
            assert_eq!(rig.devices.display.dark().await.unwrap().pattern, Pattern::Black);
        });
    }
}
