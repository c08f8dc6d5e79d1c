// Types of the map viewer. Nothing of it is served.

/** A map of a result, as the service lists it. */
interface MapInfo {
    name: string;
    width: number;
    height: number;
    kind: "direction" | "mask" | "number";
    unit: string;
    sigma: string | null;
    pixel_um: number | null;
    levels: number;
}

/** A part of a map at one of its resolutions. */
interface Tile {
    key: string;
    values: Float32Array;
    width: number;
    height: number;
}

/** The visible pixels of a map (left, top, right, bottom), device pixels per pixel, the map's corner in device pixels. */
interface Sight {
    part: number[];
    scale: number;
    origin: number[];
}

interface MapHistogram {
    low: number;
    high: number;
    counts: number[];
}

/** Statistics of a region. */
interface MapStatistics {
    pixels: number;
    step: number;
    read: number;
    valid: number;
    min: number | null;
    max: number | null;
    mean: number | null;
    sd: number | null;
    percentiles: { percent: number; value: number }[];
    histogram: MapHistogram | null;
}

/** Values along a line. */
interface LineProfile {
    length_px: number;
    x: number[];
    y: number[];
    value: (number | null)[];
    sigma: (number | null)[] | null;
}
