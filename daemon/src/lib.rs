//! The program `nacre`: command line today, service later.
