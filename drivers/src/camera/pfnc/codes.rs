//! 32-bit values of pixel formats.
//!
//! Those with the highest bit set belong to a manufacturer; other formats of manufacturers are known by name only. A
//! driver compares such a value with the name through [`super::PixelFormat::fits`].

/// Values of formats: those of the PFNC and of GigE Vision, then those of Lucid's polarization cameras.
pub const CODES: [(&str, u32); 55] = [
    ("Mono8", 0x0108_0001),
    ("Mono10", 0x0110_0003),
    ("Mono10p", 0x010A_0046),
    ("Mono10Packed", 0x010C_0004),
    ("Mono12", 0x0110_0005),
    ("Mono12p", 0x010C_0047),
    ("Mono12Packed", 0x010C_0006),
    ("Mono14", 0x0110_0025),
    ("Mono14p", 0x010E_0104),
    ("Mono16", 0x0110_0007),
    ("BayerGR8", 0x0108_0008),
    ("BayerGR10", 0x0110_000C),
    ("BayerGR10p", 0x010A_0056),
    ("BayerGR10Packed", 0x010C_0026),
    ("BayerGR12", 0x0110_0010),
    ("BayerGR12p", 0x010C_0057),
    ("BayerGR12Packed", 0x010C_002A),
    ("BayerGR14", 0x0110_0109),
    ("BayerGR14p", 0x010E_0105),
    ("BayerGR16", 0x0110_002E),
    ("BayerRG8", 0x0108_0009),
    ("BayerRG10", 0x0110_000D),
    ("BayerRG10p", 0x010A_0058),
    ("BayerRG10Packed", 0x010C_0027),
    ("BayerRG12", 0x0110_0011),
    ("BayerRG12p", 0x010C_0059),
    ("BayerRG12Packed", 0x010C_002B),
    ("BayerRG14", 0x0110_010A),
    ("BayerRG14p", 0x010E_0106),
    ("BayerRG16", 0x0110_002F),
    ("BayerGB8", 0x0108_000A),
    ("BayerGB10", 0x0110_000E),
    ("BayerGB10p", 0x010A_0054),
    ("BayerGB10Packed", 0x010C_0028),
    ("BayerGB12", 0x0110_0012),
    ("BayerGB12p", 0x010C_0055),
    ("BayerGB12Packed", 0x010C_002C),
    ("BayerGB14", 0x0110_010B),
    ("BayerGB14p", 0x010E_0107),
    ("BayerGB16", 0x0110_0030),
    ("BayerBG8", 0x0108_000B),
    ("BayerBG10", 0x0110_000F),
    ("BayerBG10p", 0x010A_0052),
    ("BayerBG10Packed", 0x010C_0029),
    ("BayerBG12", 0x0110_0013),
    ("BayerBG12p", 0x010C_0053),
    ("BayerBG12Packed", 0x010C_002D),
    ("BayerBG14", 0x0110_010C),
    ("BayerBG14p", 0x010E_0108),
    ("BayerBG16", 0x0110_0031),
    ("PolarizeMono8", 0x8108_0001),
    ("PolarizeMono12", 0x8110_0008),
    ("PolarizeMono12p", 0x810C_0047),
    ("PolarizeMono12Packed", 0x810C_0006),
    ("PolarizeMono16", 0x8110_0007),
];

/// Value of the format of this name, if it is known.
pub fn code_of(name: &str) -> Option<u32> {
    CODES.iter().find(|(known, _)| *known == name).map(|(_, code)| *code)
}
