//! Keys of headers in the languages of usual programs.

/// Meaning of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Key {
    Columns,
    Rows,
    Width,
    Height,
    Size,
    Pitch,
    PitchDown,
    Bare,
    BareDown,
    PixelUm,
    ValueUnit,
    Unit,
    NoData,
    Factor,
    Channel,
}

/// Keys in lower case, separated by bars, without brackets and punctuation.
pub(super) const KEYS: &[(Key, &[&str])] = &[
    (
        Key::Columns,
        &[
            "image width|ncols|ncol|columns|cols|xpixels|x pixels|pixels x|xres|nx|spalten|anzahl spalten|colonnes",
            "nombre de colonnes|columnas|número de columnas|colonne|numero di colonne|number of columns|points per line|samps/line",
            "x points|kolommen|colunas|столбцы|列数",
        ],
    ),
    (
        Key::Rows,
        &[
            "image height|nrows|nrow|rows|lines|ypixels|y pixels|pixels y|yres|ny|zeilen|anzahl zeilen|lignes|nombre de lignes",
            "filas|número de filas|righe|numero di righe|number of rows|number of lines|y points|rijen|linhas|строки|行数",
        ],
    ),
    (
        Key::Width,
        &[
            "real width|width|breite|largeur|ancho|anchura|larghezza|largura|breedte|šířka|sirka|szerokość|szerokosc|ширина|幅|宽度|寬度",
            "너비|bredd|bredde|leveys|genişlik|szélesség|x size|size x|xsize|x range|x length|xlength|x scan size|scan size x",
            "scan width|x scan range|x-größe|field width|w",
        ],
    ),
    (
        Key::Height,
        &[
            "real height|height|höhe|hoehe|hauteur|alto|altura|altezza|hoogte|výška|vyska|wysokość|wysokosc|высота|高さ|高度|높이|höjd",
            "høyde|højde|korkeus|yükseklik|magasság|y size|size y|ysize|y range|y length|ylength|y scan size|scan size y",
            "scan height|y scan range|y-größe|field height|h",
        ],
    ),
    (
        Key::Size,
        &[
            "scan size|scan range|image size|scan length|scangröße|scanbereich|bildgröße|taille|taille du scan|taille de l'image",
            "tamaño|tamaño de barrido|dimensioni|dimensione scansione|size|physical size",
        ],
    ),
    (
        Key::Pitch,
        &[
            "pixel size|pixelsize|pixel width|pixel pitch|pixelgröße|pixelbreite|pixelabstand|rasterweite|schrittweite|punktabstand",
            "abtastabstand|taille de pixel|taille du pixel|taille des pixels|pas d'échantillonnage|tamaño de píxel|tamaño del píxel",
            "tamaño de pixel|dimensione pixel|dimensione del pixel|tamanho do pixel|pixelgrootte|размер пикселя|sampling",
            "sampling interval|sampling distance|x spacing|spacing x|step size|x step|grid spacing|point spacing|x increment",
            "x pitch|xscale|x pixel size|ピクセルサイズ|像素尺寸",
        ],
    ),
    (Key::PitchDown, &["pixel height|pixelhöhe|y spacing|spacing y|y step|y increment|y pitch|yscale|y pixel size"]),
    (Key::Bare, &["cellsize|cell size|dx"]),
    (Key::BareDown, &["dy"]),
    (Key::PixelUm, &["pixel_um"]),
    (
        Key::ValueUnit,
        &[
            "z unit|z units|zunit|z-unit|value units|value unit|height unit|height units|data unit|data units|werteeinheit",
            "werteinheit|einheit der werte|z-einheit|z einheit|höheneinheit|unité des valeurs|unités des valeurs|unité de valeur",
            "unités de valeur|unité z|unidad de valor|unidades de valor|unidad de los valores|unidades de los valores",
            "unidades del valor|unidad z|unità dei valori|unità di valore|unità valori|unità z|unidade do valor|unidades do valor",
            "unidades de valores|eenheid waarde|waarde-eenheid|jednotky hodnot|jednotka hodnot|jednostka wartości|единицы значений",
            "единица значений|値の単位|数值单位",
        ],
    ),
    (Key::Unit, &["unit|units|einheit|einheiten|unité|unités|unidad|unidades|unità|eenheid|unidade|单位|単位"]),
    (
        Key::NoData,
        &[
            "nodata_value|nodata value|nodata|no data|no data value|no_data|missing value|missing_value|missing|fill value",
            "_fillvalue|fillvalue|bad value|invalid value|dummy|fehlwert|ungültiger wert|blank value|valeur manquante|valor nulo",
        ],
    ),
    (
        Key::Factor,
        &[
            "height conversion factor|scale factor|scaling factor|z scale factor|z factor|zfactor|zscale|z scale|multiplier",
            "z multiplier|skalierungsfaktor|facteur d'échelle|factor de escala",
        ],
    ),
    (Key::Channel, &["channel|kanal|canal|canale|kanaal|チャンネル|канал"]),
];

/// Whether the keys of an entry include this one.
pub(super) fn holds(keys: &[&str], name: &str) -> bool {
    keys.iter().flat_map(|line| line.split('|')).any(|key| key == name)
}

/// Meaning of a key.
pub(super) fn find(name: &str) -> Option<Key> {
    KEYS.iter().find(|(_, keys)| holds(keys, name)).map(|(key, _)| *key)
}
