//! Polarization imaging: Jones and Stokes calculus, and the fit of intensity against analyser angle.
