#![doc = include_str!("../README.md")]

pub mod color;
pub mod geometry;
pub mod polarization;
pub mod rcwa;
