//! The page, its scripts and shaders, embedded in the binary. Empty until the service exists.
