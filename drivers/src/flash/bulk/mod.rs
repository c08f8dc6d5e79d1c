//! A flash with bulk transfers: the template for own electronics.

/// Vendor number: that of pid.codes, whose product 1 is for experiments.
pub const VENDOR: u16 = 0x1209;
/// Product number.
pub const PRODUCT: u16 = 0x0001;
/// What it says that it is.
pub const NAME: &str = "Nacre flash";
