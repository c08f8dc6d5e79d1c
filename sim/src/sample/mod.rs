//! Synthetic diffracting surfaces.
