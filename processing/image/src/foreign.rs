//! Formats that are recognised and refused by name.

use super::fault::Fault;

/// Remedy that keeps the depth and applies no tone curve.
const DEEP: &str = "convert it to a 16-bit PNG or TIFF (an 8-bit one loses depth)";
const PLAIN: &str = "convert it to PNG or TIFF of the same depth";

/// Error for a known unsupported format by the first bytes of the file; `None` for unknown formats.
pub(super) fn refusal(head: &[u8]) -> Option<Fault> {
    let refuse = |name: &str, remedy| Some(Fault::unusable(format!("is a {name} file, which is not read"), remedy));
    if let [0, 0, 0, _, b'f', b't', b'y', b'p', brand @ ..] = head {
        return match brand.first_chunk()? {
            b"avif" | b"avis" => refuse("AVIF", DEEP),
            b"heic" | b"heix" | b"heim" | b"heis" | b"hevc" | b"hevx" | b"mif1" | b"mif2" | b"msf1" => {
                refuse("HEIC", DEEP)
            }
            b"jxl " => refuse("JPEG XL", DEEP),
            b"jp2 " | b"jpx " => refuse("JPEG 2000", DEEP),
            b"qt  " | b"isom" | b"iso2" | b"mp41" | b"mp42" | b"M4V " => refuse("video", "export single frames as PNG"),
            _ => refuse("MPEG-4 container", DEEP),
        };
    }
    match head {
        [0, 0, 0, 12, b'J', b'X', b'L', b' ', ..] | [0xff, 0x0a, ..] => refuse("JPEG XL", DEEP),
        [0, 0, 0, 12, b'j', b'P', b' ', b' ', ..] | [0xff, 0x4f, 0xff, 0x51, ..] => refuse("JPEG 2000", DEEP),
        [b'I', b'I', 0xbc, 1, ..] => refuse("JPEG XR", DEEP),
        [b'8', b'B', b'P', b'S', ..] => refuse("Photoshop", DEEP),
        [b'g', b'i', b'm', b'p', b' ', b'x', b'c', b'f', ..] => refuse("GIMP", DEEP),
        [b'P', b'1'..=b'7', b'\n' | b' ' | b'\r' | b'\t', ..] => refuse("PNM or PAM", PLAIN),
        [b'P', b'F' | b'f', b'\n' | b' ' | b'\r' | b'\t', ..] => {
            refuse("PFM", "convert it to OpenEXR or a 32-bit TIFF")
        }
        [b'G', b'I', b'F', b'8', ..] => refuse("GIF", PLAIN),
        [b'P', b'K', 3, 4, ..] => refuse("ZIP (or NPZ)", "unpack it, and save arrays with `numpy.save`"),
        [0x89, b'H', b'D', b'F', ..] => refuse("HDF5", "export the image as 16-bit TIFF or FITS"),
        [b'%', b'P', b'D', b'F', ..] => refuse("PDF", PLAIN),
        [0x1f, 0x8b, ..] => refuse("gzip-compressed", "decompress it with `gunzip`"),
        _ if head.get(128..132) == Some(b"DICM") => refuse("DICOM", DEEP),
        _ => None,
    }
}
