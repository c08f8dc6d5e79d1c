//! Description of a stored calibration.

use crate::plan::CalibrationKind;
use crate::session::SessionFile;
use nacre_base::Version;
use nacre_drivers::stage::Mounting;
use nacre_frames::{
    AnalyserCalibration, Calibration, CalibrationSource, CameraCalibration, FlatCalibration, OrientationCalibration,
    RetarderCalibration,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

impl CalibrationKind {
    /// True if a calibration holds this kind.
    pub(super) fn is_in(self, calibration: &Calibration) -> bool {
        match self {
            Self::Camera => calibration.camera.is_some(),
            Self::Flat => calibration.flat.is_some(),
            Self::Analyser => calibration.analyser.is_some(),
            Self::Retarder => calibration.retarder.is_some(),
            Self::Orientation => calibration.orientation.is_some(),
        }
    }

    /// Moves this kind from one calibration to another, with its origin.
    pub(super) fn transfer(self, from: Calibration, source: CalibrationSource, to: &mut Calibration) {
        let source = Some(source);
        match self {
            Self::Camera => to.camera = from.camera.map(|own| CameraCalibration { source, ..own }),
            Self::Flat => to.flat = from.flat.map(|own| FlatCalibration { source, ..own }),
            Self::Analyser => to.analyser = from.analyser.map(|own| AnalyserCalibration { source, ..own }),
            Self::Retarder => to.retarder = from.retarder.map(|own| RetarderCalibration { source, ..own }),
            Self::Orientation => to.orientation = from.orientation.map(|own| OrientationCalibration { source, ..own }),
        }
    }
}

/// `record.json` of a stored calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Record {
    /// Version of the format.
    #[serde(default)]
    pub version: Version<1>,
    /// Identifier: the name of its folder.
    pub id: String,
    /// Kind of the calibration.
    pub kind: CalibrationKind,
    /// Name (at most 200 characters).
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// Notes (at most 10,000 characters).
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub notes: String,
    /// Time of its photographs in Unix seconds.
    pub taken: u64,
    /// Identities of the devices that it depends on: the camera; for a flat field camera and panel; for analyser and
    /// orientation the stage; for the retarder the panel.
    pub devices: Vec<String>,
    /// Conditions of its photographs.
    #[serde(default)]
    pub conditions: Conditions,
    /// Session of its photographs: the name of its folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub session: Option<String>,
    /// Reconstruction of the service from which it was kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reconstruction: Option<String>,
    /// Version of the program that kept it.
    pub software: String,
}

/// Conditions of a calibration's photographs. Unknown ones are absent.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Conditions {
    /// Exposure time in s of photographs without a stated one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure_s: Option<f64>,
    /// Gain of the camera.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
    /// Number of exposures averaged into each photograph.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub average: Option<u32>,
    /// Centre wavelength of the filter in nm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    /// Bandwidth of the filter in nm (full width at half maximum).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub band_nm: Option<f64>,
    /// Pixels of the camera that a flat field covers: left, top, width, height.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region: Option<[u32; 4]>,
    /// Mounting of the analyser on its stage, if it is not the default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mounting: Option<Mounting>,
}

/// Origin of a calibration that is kept.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// Name.
    pub name: String,
    /// Notes.
    pub notes: String,
    /// Time of the photographs in Unix seconds.
    pub taken: u64,
    /// Identities of the devices that it depends on.
    pub devices: Vec<String>,
    /// Conditions of the photographs.
    pub conditions: Conditions,
    /// Session of the photographs.
    pub session: Option<String>,
    /// Reconstruction of the service.
    pub reconstruction: Option<String>,
}

impl Origin {
    /// Origin of a calibration from the photographs of a session.
    pub fn of_session(kind: CalibrationKind, folder: &Path, session: &SessionFile) -> Self {
        let (plan, setup) = (&session.plan, &session.setup);
        // Devices of a session are stage, camera, panel and flash, in this order.
        let device = |k: usize| session.devices.get(k).cloned();
        let devices = match kind {
            CalibrationKind::Camera => vec![device(1)],
            CalibrationKind::Flat => vec![device(1), device(2)],
            CalibrationKind::Retarder => vec![device(2)],
            CalibrationKind::Analyser | CalibrationKind::Orientation => vec![device(0)],
        };
        Self {
            name: plan.name.clone(),
            notes: plan.notes.clone(),
            taken: session.created,
            devices: devices.into_iter().flatten().collect(),
            conditions: Conditions {
                exposure_s: Some(session.exposure_s),
                gain: Some(plan.camera.gain),
                average: Some(plan.camera.average),
                wavelength_nm: setup.wavelength_nm,
                band_nm: setup.band_nm,
                region: plan.camera.roi.filter(|_| kind == CalibrationKind::Flat),
                mounting: session.mounting,
            },
            session: folder.file_name().map(|name| name.to_string_lossy().into_owned()),
            reconstruction: None,
        }
    }
}
