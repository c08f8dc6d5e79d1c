#![doc = include_str!("../README.md")]

pub mod calibration;
pub mod flash;
pub mod fringes;
