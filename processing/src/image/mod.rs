//! Images in and out: photographs of any usual format, EXR maps, pictures, and the transactional output folder.
