//! Image files as NumPy arrays, row 0 at the top.

use crate::raised;
use nacre_image::{Attribute, Samples, read, read_exr, write_exr, write_png16_gray};
use numpy::{IntoPyArray, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// All channels of an EXR map as a dictionary of float32 arrays (height, width), NaN where masked, and the file's
/// attributes.
#[pyfunction]
pub fn read_maps(py: Python<'_>, path: PathBuf) -> PyResult<(Bound<'_, PyDict>, Bound<'_, PyDict>)> {
    let map = py.detach(|| read_exr(&path)).map_err(raised)?;
    let channels = PyDict::new(py);
    for (name, plane) in map.channels {
        channels.set_item(name, plane.into_pyarray(py).reshape([map.height, map.width])?)?;
    }
    let attributes = PyDict::new(py);
    for (name, value) in map.attributes {
        attributes.set_item(name, value)?;
    }
    Ok((channels, attributes))
}

/// Writes float32 arrays (height, width) of one size as the channels of an uncompressed EXR map.
#[pyfunction]
pub fn write_maps(
    py: Python<'_>,
    path: PathBuf,
    channels: Vec<(String, PyReadonlyArray2<'_, f32>)>,
    attributes: Vec<(String, String)>,
) -> PyResult<()> {
    let Some(shape) = channels.first().map(|(_, array)| array.shape().to_vec()) else {
        return Err(PyValueError::new_err("give at least one array"));
    };
    if channels.iter().any(|(_, array)| array.shape() != shape) {
        return Err(PyValueError::new_err("all arrays of a map have one shape"));
    }
    let contiguous = |e| PyValueError::new_err(format!("{e}; use numpy.ascontiguousarray"));
    let planes: Vec<&[f32]> =
        channels.iter().map(|(_, array)| array.as_slice().map_err(contiguous)).collect::<PyResult<_>>()?;
    let names: Vec<&str> = channels.iter().map(|(name, _)| name.as_str()).collect();
    let attributes: Vec<(&str, Attribute)> =
        attributes.iter().map(|(name, text)| (name.as_str(), Attribute::Text(text.clone()))).collect();
    let (height, width) = (shape[0], shape[1]);
    let fill = |channel: usize, row: usize, values: &mut [f32]| {
        values.copy_from_slice(&planes[channel][row * width..(row + 1) * width]);
    };
    py.detach(|| write_exr(&path, width, height, &names, &attributes, &fill)).map_err(raised)
}

/// A photograph of any format as an array (height, width) or (height, width, 3) of uint8, uint16 or float32.
#[pyfunction]
pub fn read_photograph(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyAny>> {
    let raster = py.detach(|| read(&path)).map_err(raised)?;
    let shape = match raster.channels {
        1 => vec![raster.height, raster.width],
        channels => vec![raster.height, raster.width, channels],
    };
    Ok(match raster.samples {
        Samples::U8(v) => v.into_pyarray(py).reshape(shape)?.into_any(),
        Samples::U16(v) => v.into_pyarray(py).reshape(shape)?.into_any(),
        Samples::F32(v) => v.into_pyarray(py).reshape(shape)?.into_any(),
    })
}

/// Writes an array (height, width) of uint16 as a 16-bit PNG.
#[pyfunction]
pub fn write_photograph(py: Python<'_>, path: PathBuf, codes: PyReadonlyArray2<'_, u16>) -> PyResult<()> {
    let shape = codes.shape().to_vec();
    let codes = codes.as_slice().map_err(|e| PyValueError::new_err(format!("{e}; use numpy.ascontiguousarray")))?;
    py.detach(|| write_png16_gray(&path, shape[1], shape[0], codes)).map_err(raised)
}
