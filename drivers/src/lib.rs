//! Device traits and drivers.
