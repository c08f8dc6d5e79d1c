//! Automatic functions of a camera, which a measurement must not have.

use super::AravisNode;
use super::ffi::{self, ArvCamera};
use super::safe::text;
use crate::camera::genicam::node::{Cause, NodeResult};
use std::ffi::{CStr, c_int};
use std::ptr;

/// Automatic functions without functions of their own in the library: name of the feature, and the words for it.
const OTHER_AUTOMATIC: [(&CStr, &str); 2] =
    [(c"BalanceWhiteAuto", "automatic white balance"), (c"TargetBrightnessAuto", "automatic brightness")];

impl AravisNode {
    /// Disables automatic functions; returns those that remain active.
    pub(super) fn disable_automatic(&self) -> NodeResult<Vec<String>> {
        let mut left = vec![];
        for (name, available, set, get) in [
            (
                "automatic exposure",
                ffi::arv_camera_is_exposure_auto_available as unsafe extern "C" fn(_, _) -> _,
                ffi::arv_camera_set_exposure_time_auto as unsafe extern "C" fn(_, _, _),
                ffi::arv_camera_get_exposure_time_auto as unsafe extern "C" fn(_, _) -> _,
            ),
            (
                "automatic gain",
                ffi::arv_camera_is_gain_auto_available,
                ffi::arv_camera_set_gain_auto,
                ffi::arv_camera_get_gain_auto,
            ),
            (
                "automatic black level",
                ffi::arv_camera_is_black_level_auto_available,
                ffi::arv_camera_set_black_level_auto,
                ffi::arv_camera_get_black_level_auto,
            ),
        ] {
            if self.remains_automatic(available, set, get)? {
                left.push(format!("{name} cannot be disabled"));
            }
        }
        for (feature, name) in OTHER_AUTOMATIC {
            // SAFETY: the names end with zero; the string is copied at once.
            let value = self.call(|camera, error| unsafe {
                if ffi::arv_camera_is_feature_available(camera, feature.as_ptr(), error) == 0 {
                    return "Off".to_owned();
                }
                ffi::arv_camera_set_string(camera, feature.as_ptr(), c"Off".as_ptr(), ptr::null_mut());
                text(ffi::arv_camera_get_string(camera, feature.as_ptr(), error))
            });
            // A feature that cannot be read does not concern this camera.
            if value.is_ok_and(|value| value != "Off") {
                left.push(format!("{name} cannot be disabled"));
            }
        }
        Ok(left)
    }

    /// Disables one automatic function; returns whether it remains active.
    fn remains_automatic(
        &self,
        available: unsafe extern "C" fn(*mut ArvCamera, ffi::Errors) -> c_int,
        set: unsafe extern "C" fn(*mut ArvCamera, c_int, ffi::Errors),
        get: unsafe extern "C" fn(*mut ArvCamera, ffi::Errors) -> c_int,
    ) -> NodeResult<bool> {
        if !self.has(available) {
            return Ok(false);
        }
        // The readback decides, not the error of the setter.
        // SAFETY: the camera lives as long as `self`.
        let set = self.call(|camera, error| unsafe { set(camera, ffi::AUTO_OFF, error) });
        set.or_else(|e| if e.cause == Cause::Gone { Err(e) } else { Ok(()) })?;
        // SAFETY: as above.
        Ok(self.call(|camera, error| unsafe { get(camera, error) })? != ffi::AUTO_OFF)
    }
}
