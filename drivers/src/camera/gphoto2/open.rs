//! Set-up of a camera: manual exposure, memory, focus, format, and the choices of its settings.

use super::faults::{self, setup};
use super::labels::{self, Speed};
use super::node::{Cause, Control, Failure, Node};
use super::settings::{Format, Settings};
use crate::{Class, DeviceError, DeviceResult};

/// Names of the exposure mode.
const MODES: [&str; 3] = ["expprogram", "autoexposuremode", "exposuremode"];
/// Names of the shutter speed; where a camera has both, the first states exact values.
const SPEEDS: [&str; 2] = ["shutterspeed2", "shutterspeed"];
const APERTURES: [&str; 2] = ["aperture", "f-number"];
const SENSITIVITIES: [&str; 1] = ["iso"];
const FORMATS: [&str; 2] = ["imageformat", "imagequality"];
/// Switches of the automatic sensitivity.
const AUTO_ISO: [&str; 2] = ["isoauto", "autoiso"];

/// Charge in percent below which no session begins, and below which there is a warning.
const BATTERY: [f64; 2] = [6.0, 25.0];
/// Free space in KiB on a memory card below which it counts as full: two large raw files.
const CARD_KIB: u64 = 128 << 10;
/// Relative difference of apertures that count as equal.
const SAME_APERTURE: f64 = 0.03;
/// Maximum number of choices in a message.
const MAX_NAMED: usize = 40;
/// Instruction for a camera that chooses its exposure.
const DIAL: &str = "turn the camera's mode dial to M";

/// A setting with its choices.
#[derive(Clone, Debug)]
pub(super) struct Choices {
    pub name: &'static str,
    /// Labels with values.
    pub values: Vec<(String, f64)>,
}

/// A camera after set-up.
pub(super) struct Opened {
    pub id: String,
    pub speeds: Choices,
    /// Sensitivities from the lowest; `None` for a camera without this setting.
    pub sensitivities: Option<Choices>,
    /// Whether photographs go to the camera's internal memory, from which the driver deletes them.
    pub internal: bool,
    pub warnings: Vec<String>,
}

impl Choices {
    /// The label of the choice that is nearest to a value.
    pub(super) fn nearest(&self, value: f64) -> Option<&(String, f64)> {
        let off = |choice: f64| (choice / value).ln().abs();
        self.values.iter().min_by(|a, b| off(a.1).total_cmp(&off(b.1)))
    }

    fn read(control: Control, value: impl Fn(&str) -> Option<f64>) -> Self {
        let valued = |label: String| value(&label).map(|value| (label, value));
        Self { name: control.name, values: control.choices.into_iter().filter_map(valued).collect() }
    }
}

impl Opened {
    pub(super) fn new(node: &mut dyn Node, settings: &Settings) -> DeviceResult<Self> {
        settings.check().map_err(faults::wrong_settings)?;
        let model = node.model();
        let mut camera = SetUp { id: format!("gphoto2 {model}"), node, warnings: vec![] };
        let serial = camera.first(&["eosserialnumber", "serialnumber"])?.map(|c| c.value).unwrap_or_default();
        if !serial.is_empty() {
            camera.id = format!("gphoto2 {model} s/n {serial}");
        }
        camera.check_mode()?;
        camera.check_battery()?;
        let internal = camera.choose_memory()?;
        camera.switch_focus_off()?;
        camera.choose_format(settings.format)?;
        let speeds = camera.speeds()?;
        if let Some(aperture) = settings.aperture {
            camera.choose_aperture(aperture)?;
        }
        let sensitivities = camera.sensitivities(&settings.iso)?;
        Ok(Self { id: camera.id, speeds, sensitivities, internal, warnings: camera.warnings })
    }
}

struct SetUp<'a> {
    id: String,
    node: &'a mut dyn Node,
    warnings: Vec<String>,
}

impl SetUp<'_> {
    fn failed(&self, command: &str, failure: &Failure) -> DeviceError {
        faults::command(&self.id, command, "a setting", failure)
    }

    /// The first of these settings that the camera has.
    fn first(&mut self, names: &[&'static str]) -> DeviceResult<Option<Control>> {
        for name in names {
            let control = self.node.control(name).map_err(|e| self.failed(&format!("read {name}"), &e))?;
            if control.is_some() {
                return Ok(control);
            }
        }
        Ok(None)
    }

    /// Sets a label and reads it back.
    fn set(&mut self, name: &'static str, label: &str) -> DeviceResult<()> {
        set(self.node, &self.id, name, label)
    }

    fn refuse(&self, expected: impl Into<Box<str>>, got: impl Into<Box<str>>, remedy: &str) -> DeviceError {
        setup(&self.id, expected, got).remedy(remedy)
    }

    fn check_mode(&mut self) -> DeviceResult<()> {
        for name in MODES {
            if let Some(mode) = self.first(&[name])?.filter(|mode| !mode.value.is_empty())
                && !labels::is_manual(&mode.value)
            {
                let got = format!("the exposure mode {}", mode.value);
                return Err(self.refuse("manual exposure (M)", got, DIAL));
            }
        }
        Ok(())
    }

    fn check_battery(&mut self) -> DeviceResult<()> {
        let Some(level) = self.first(&["batterylevel"])? else { return Ok(()) };
        let Some(percent) = labels::battery(&level.value) else { return Ok(()) };
        if percent < BATTERY[0] {
            let low = Failure::new(Cause::Battery, format!("a battery at {}", level.value));
            return Err(faults::command(&self.id, "open", "a charged battery", &low));
        }
        if percent < BATTERY[1] {
            self.warnings.push(format!("the camera's battery is at {}", level.value));
        }
        Ok(())
    }

    /// Chooses the internal memory if possible; otherwise checks the memory card.
    fn choose_memory(&mut self) -> DeviceResult<bool> {
        if let Some(target) = self.first(&["capturetarget"])? {
            let ram = target.choices.iter().find(|label| label.to_ascii_lowercase().contains("ram"));
            if let Some(label) = ram {
                if *label != target.value {
                    self.set("capturetarget", label)?;
                }
                return Ok(true);
            }
        }
        let storages = match self.node.storages() {
            Ok(storages) => storages,
            Err(failure) if failure.cause == Cause::Unsupported => return Ok(false),
            Err(failure) => return Err(self.failed("read its memory cards", &failure)),
        };
        let problem = if storages.is_empty() {
            Some((Cause::NoCard, "none"))
        } else if !storages.iter().any(|s| s.writable) {
            Some((Cause::CardProtected, "one that is write-protected"))
        } else if !storages.iter().any(|s| s.writable && s.free_kib.is_none_or(|free| free >= CARD_KIB)) {
            Some((Cause::CardFull, "a full one"))
        } else {
            None
        };
        match problem {
            Some((cause, got)) => {
                Err(faults::command(&self.id, "open", "a memory card with free space", &Failure::new(cause, got)))
            }
            None => Ok(false),
        }
    }

    /// Switches the autofocus before photographs off, which fails in the dark.
    fn switch_focus_off(&mut self) -> DeviceResult<()> {
        if let Some(autofocus) = self.first(&["autofocus"])?
            && autofocus.value.eq_ignore_ascii_case("on")
            && let Some(off) = autofocus.choices.iter().find(|label| label.eq_ignore_ascii_case("off"))
        {
            self.set("autofocus", off)?;
        }
        if let Some(mode) = self.first(&["focusmode"])?
            && !mode.value.is_empty()
            && !mode.value.to_ascii_lowercase().starts_with('m')
        {
            let warning = format!("the focus mode is {}: switch the lens to manual focus", mode.value);
            self.warnings.push(warning);
        }
        Ok(())
    }

    fn choose_format(&mut self, format: Format) -> DeviceResult<()> {
        // A camera without this setting shows its format by its photographs.
        let Some(control) = self.first(&FORMATS)?.filter(|c| !c.choices.is_empty()) else { return Ok(()) };
        let raw = format == Format::Raw;
        if labels::image_format(&control.value) == Some(raw) {
            return Ok(());
        }
        let fitting = control.choices.iter().find(|label| labels::image_format(label) == Some(raw));
        match fitting {
            Some(label) => self.set(control.name, label),
            None => {
                let expected = if raw { "raw files without JPEG" } else { "JPEG without raw files" };
                let got = format!("only {}", named(&control.choices));
                Err(self.refuse(expected, got, "choose another `format` for the camera in the configuration"))
            }
        }
    }

    fn speeds(&mut self) -> DeviceResult<Choices> {
        let Some(control) = self.first(&SPEEDS)? else {
            return Err(self.refuse("a setting of the shutter speed", "a camera without one", DIAL));
        };
        let (value, read_only) = (control.value.clone(), control.read_only);
        let speeds = Choices::read(control, |label| match labels::speed(label) {
            Some(Speed::Seconds(seconds)) => Some(seconds),
            _ => None,
        });
        if read_only || speeds.values.is_empty() {
            let got = match labels::speed(&value) {
                Some(Speed::Bulb) => "bulb or time alone".to_owned(),
                _ => format!("{value} alone"),
            };
            return Err(self.refuse("shutter speeds that can be set", got, DIAL));
        }
        Ok(speeds)
    }

    fn choose_aperture(&mut self, wanted: f64) -> DeviceResult<()> {
        let remedy = "choose one of these as `aperture`, or leave it out for a lens with an aperture ring";
        let Some(control) = self.first(&APERTURES)? else {
            return Err(self.refuse(format!("the aperture f/{wanted}"), "a camera without this setting", remedy));
        };
        let offered = control.choices.clone();
        let choices = Choices::read(control, labels::aperture);
        let nearest = choices.nearest(wanted).filter(|(_, f)| (f / wanted - 1.0).abs() <= SAME_APERTURE).cloned();
        match nearest {
            Some((label, _)) => self.set(choices.name, &label),
            None => {
                let got = format!("only {}", named(&offered));
                Err(self.refuse(format!("the aperture f/{wanted}"), got, remedy))
            }
        }
    }

    /// Sensitivities from the lowest, with the automatic one switched off.
    fn sensitivities(&mut self, permitted: &[f64]) -> DeviceResult<Option<Choices>> {
        if let Some(auto) = self.first(&AUTO_ISO)? {
            let off =
                ["Off", "0"].into_iter().find(|off| auto.choices.is_empty() || auto.choices.iter().any(|c| c == off));
            let is_off = auto.value == "0" || auto.value.eq_ignore_ascii_case("off");
            if let Some(off) = off.filter(|_| !is_off && !auto.read_only) {
                let off = if auto.choices.is_empty() { "0" } else { off };
                self.set(auto.name, off)?;
            }
        }
        let Some(control) = self.first(&SENSITIVITIES)? else { return Ok(None) };
        let offered = control.choices.clone();
        let (read_only, value) = (control.read_only, control.value.clone());
        let mut choices = Choices::read(control, labels::iso);
        choices.values.sort_by(|a, b| a.1.total_cmp(&b.1));
        let permits = |iso: f64| permitted.is_empty() || permitted.contains(&iso);
        choices.values.retain(|(_, iso)| permits(*iso));
        if read_only {
            return match labels::iso(&value) {
                Some(_) => Ok(None),
                None => Err(self.refuse("a fixed sensitivity", format!("ISO {value}"), DIAL)),
            };
        }
        if choices.values.is_empty() {
            let got = format!("only {}", named(&offered));
            return Err(self.refuse("the sensitivities in `iso`", got, "choose `iso` among these"));
        }
        Ok(Some(choices))
    }
}

/// Sets a label and checks that the camera states it afterwards.
pub(super) fn set(node: &mut dyn Node, id: &str, name: &'static str, label: &str) -> DeviceResult<()> {
    let command = format!("set {name} to {label}");
    let failed = |failure: &Failure| faults::command(id, &command, label, failure);
    node.set(name, label).map_err(|e| failed(&e))?;
    let value = read(node, id, name)?;
    if value == label {
        return Ok(());
    }
    Err(DeviceError::new(id, command.as_str(), label, value)
        .remedy("check the camera's dials and its display: it refused the value")
        .class(Class::Setup))
}

/// Value of a setting.
pub(super) fn read(node: &mut dyn Node, id: &str, name: &'static str) -> DeviceResult<String> {
    let control = node.control(name).map_err(|e| faults::command(id, &format!("read {name}"), "a value", &e))?;
    Ok(control.map(|c| c.value).unwrap_or_default())
}

fn named(choices: &[String]) -> String {
    choices.iter().take(MAX_NAMED).map(String::as_str).collect::<Vec<_>>().join(", ")
}
