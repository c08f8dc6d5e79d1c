//! A camera of which only settings and photographs exist.

use super::node::{CameraFile, Cause, Control, Failure, Node, NodeResult, Storage};
use crate::camera::photograph::{Channel, Photograph, PhotographReader, Shot};
use std::path::Path;
use std::sync::{Arc, Mutex};

/// State of the camera, shared with the test.
#[derive(Default)]
pub struct State {
    pub controls: Vec<Control>,
    pub storages: Vec<Storage>,
    pub captured: usize,
    pub deleted: usize,
    /// Error of the next photograph.
    pub failure: Option<Failure>,
    /// Setting that does not follow.
    pub stuck: Option<&'static str>,
    pub size: usize,
}

#[derive(Clone)]
pub struct Fake(pub Arc<Mutex<State>>);

fn control(name: &'static str, value: &str, choices: &[&str]) -> Control {
    let choices = choices.iter().map(|c| (*c).to_owned()).collect();
    Control { name, value: value.into(), choices, read_only: false }
}

impl Fake {
    pub fn new() -> Self {
        let controls = vec![
            control("serialnumber", "4711", &[]),
            control("autoexposuremode", "Manual", &["P", "Manual"]),
            control("batterylevel", "80%", &[]),
            control("capturetarget", "Memory card", &["Internal RAM", "Memory card"]),
            control("imageformat", "RAW + Large Fine JPEG", &["Large Fine JPEG", "RAW + Large Fine JPEG", "RAW"]),
            control("shutterspeed", "bulb", &["bulb", "30", "1", "1/60", "1/100", "1/4000"]),
            control("aperture", "5.6", &["4", "5.6", "8"]),
            control("iso", "Auto", &["Auto", "400", "100", "200"]),
        ];
        Self(Arc::new(Mutex::new(State { controls, size: 4, ..State::default() })))
    }

    pub fn change(&self, name: &str, value: &str) {
        self.control(name, |control| control.value = value.into());
    }

    pub fn control(&self, name: &str, change: impl FnOnce(&mut Control)) {
        let mut state = self.0.lock().unwrap();
        change(state.controls.iter_mut().find(|c| c.name == name).unwrap());
    }

    pub fn remove(&self, name: &str) {
        self.0.lock().unwrap().controls.retain(|c| c.name != name);
    }

    pub fn value(&self, name: &str) -> String {
        self.0.lock().unwrap().controls.iter().find(|c| c.name == name).unwrap().value.clone()
    }
}

impl Node for Fake {
    fn model(&mut self) -> String {
        "Acme Reflex".into()
    }

    fn control(&mut self, name: &'static str) -> NodeResult<Option<Control>> {
        Ok(self.0.lock().unwrap().controls.iter().find(|c| c.name == name).cloned())
    }

    fn set(&mut self, name: &'static str, value: &str) -> NodeResult<()> {
        let mut state = self.0.lock().unwrap();
        if state.stuck == Some(name) {
            return Ok(());
        }
        let control = state.controls.iter_mut().find(|c| c.name == name);
        let control = control.filter(|c| c.choices.iter().any(|choice| choice == value));
        control.ok_or_else(|| Failure::new(Cause::Unsupported, "no such value"))?.value = value.into();
        Ok(())
    }

    fn capture(&mut self) -> NodeResult<CameraFile> {
        let mut state = self.0.lock().unwrap();
        state.captured += 1;
        match state.failure.take() {
            Some(failure) => Err(failure),
            None => Ok(CameraFile { folder: "/".into(), name: format!("{}.raw", state.captured) }),
        }
    }

    fn fetch(&mut self, _: &CameraFile, limit: u64) -> NodeResult<Vec<u8>> {
        let size = self.0.lock().unwrap().size;
        assert!(size as u64 <= limit);
        Ok(vec![7; size])
    }

    fn delete(&mut self, _: &CameraFile) -> NodeResult<()> {
        self.0.lock().unwrap().deleted += 1;
        Ok(())
    }

    fn storages(&mut self) -> NodeResult<Vec<Storage>> {
        Ok(self.0.lock().unwrap().storages.clone())
    }
}

/// Takes every byte for a pixel of one row.
pub struct Bytes {
    pub raw: bool,
}

impl PhotographReader for Bytes {
    fn kind(&self, _: &str) -> Option<bool> {
        Some(self.raw)
    }

    fn shot(&self, _: &Path) -> Result<Shot, String> {
        Ok(Shot { raw: self.raw, ..Shot::default() })
    }

    fn read(&self, _: &Path, _: Channel) -> Result<Photograph, String> {
        Err("no files".into())
    }

    fn read_bytes(&self, _: &str, bytes: &[u8], _: Channel) -> Result<Photograph, String> {
        let codes: Vec<u16> = bytes.iter().map(|b| u16::from(*b)).collect();
        let shot = Shot { raw: self.raw, ..Shot::default() };
        Ok(Photograph { shot, width: codes.len(), height: 1, codes, black: 0, white: 255 })
    }
}
