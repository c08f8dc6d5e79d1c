//! Formats that are recognised but not supported.

/// Magic numbers at an offset, and names of their formats.
const MAGICS: &[(usize, &[u8], &str)] = &[
    (0, b"DIGITAL SURF", "surface file of Digital Surf (.sur)"),
    (0, b"DSCOMPRESSED", "compressed surface file of Digital Surf (.sur)"),
    (0, b"\x89HDF\r\n\x1a\n", "HDF5 file"),
    (0, b"CDF\x01", "NetCDF file"),
    (0, b"CDF\x02", "NetCDF file"),
    (0, b"\x93NUMPY", "NumPy array (.npy)"),
    (0, b"MATLAB", "MATLAB file (.mat)"),
    (0, b"SIMPLE  =", "FITS image"),
    (0, b"\x88\x1b\x03\x6f", "Zygo MetroPro file"),
    (0, b"\x88\x1b\x03\x70", "Zygo MetroPro file"),
    (0, b"\x88\x1b\x03\x71", "Zygo MetroPro file"),
    (0, b"\x01\x00Directory", "Wyko file (.opd)"),
    (0, b"VCA DATA\x01\x00\x00\x55", "Bruker profilometer file (.OPDx)"),
    (0, b"VK3", "Keyence file"),
    (0, b"VK4_", "Keyence file"),
    (0, b"VK6", "Keyence file"),
    (0, b"KPK0", "Keyence file (.zon)"),
    (0, b"FRTM_G", "FRT file"),
    (0, b"AliconaImaging", "Alicona file (.al3d)"),
    (0, b"WSxM file copyright", "WSxM file"),
    (0, b"\x01\xb0\x93\xff", "NT-MDT file (.mdt)"),
    (0, b"fileType      Image", "Molecular Imaging file (.mi)"),
    (0, b"fileType      Spectroscopy", "Molecular Imaging file (.mi)"),
    (0, b"Binary TrueMap Data File", "TrueMap file (.tmd)"),
    (0, b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "OLE file, of Mountains or Excel for example"),
    (0, b"PK\x03\x04", "ZIP archive, of Excel for example"),
    (0, b"P2\n", "PGM image"),
    (0, b"P5\n", "PGM image"),
    (0, b"%PDF", "PDF"),
    (0, b"\x1f\x8b", "gzip file"),
    (0, b"7z\xbc\xaf\x27\x1c", "7-Zip archive"),
    (2, b"S\0T\0i\0M\0A\0G\0E\0", "RHK file (.sm4)"),
    (0, b"GIF8", "GIF image"),
    (0, b"RIFF", "WebP image or other RIFF file"),
    (0, b"solid ", "STL mesh"),
    (0, b"ply\n", "PLY mesh"),
    (0, b"ply\r", "PLY mesh"),
];

/// Name of an unsupported format.
pub(in crate::height) fn name(bytes: &[u8]) -> Option<&'static str> {
    let matches =
        |(at, magic, _): &&(usize, &[u8], &'static str)| bytes.get(*at..).is_some_and(|b| b.starts_with(magic));
    MAGICS.iter().find(matches).map(|(_, _, name)| *name)
}
