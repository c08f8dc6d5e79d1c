// What the service answers, as far as the page reads it; the whole of it is in its OpenAPI document. Nothing of it is served.

interface Devices {
    activity: "idle" | "manual" | "session";
    session: string | null;
    simulated: boolean;
    stage: { id: string; analyser_deg: number | null; limits_deg: Point; speed_deg_s: number; by_hand: boolean; halts: boolean };
    camera: {
        id: string; width: number; height: number; exposure_ms: number; gain: number; exposure_range_ms: Point; gain_range: Point;
        black: number; white: number; warnings: string[];
    };
    display: { id: string; size_mm: Point; pattern: Pattern };
    flash: { id: string; on: boolean; max_on_s: number } | null;
    interlocks: { id: string; holds: boolean | null }[];
}

/** A stored calibration of the bench. */
interface Reference {
    id: string;
    kind: "camera" | "flat" | "analyser" | "retarder" | "orientation";
    name: string;
    notes: string;
    taken: number;
    age_days: number;
    devices: string[];
    conditions: Record<string, any>;
    session: string | null;
    reconstruction: string | null;
    software: string;
    applies: boolean;
    reason: string | null;
    // Values and reports differ with the kind.
    values: any;
    report?: any;
}

interface CalibrationList {
    items: Reference[];
    problems: string[];
    max_age_days: number;
}

/** An operation, and the JSON Schema of its options. */
interface Offered {
    name: string;
    title: string;
    options: any;
}

type Pattern = "black" | { disc?: { center_mm: Point; diameter_mm: number } };

/** Uploaded photographs of the mirror image of a light that is no point. */
interface LightUpload {
    upload: string;
    scale: number | null;
    center: Point | null;
    transfer: string | { gamma: number } | null;
}

/** What a device did not do as it was asked. */
interface Fault {
    device: string;
    command: string;
    expected: string;
    got: string;
    remedy: string;
    class: "retry" | "lost" | "stop" | "setup";
}

/** A simulated sample. */
interface Sample {
    kind: string;
    about: string;
}

/** What the devices do now. */
interface Activity {
    activity: "homing" | "lighting" | "turning" | "exposing" | "saving";
    analyser_deg?: number;
    exposure_s?: number;
    eta_s?: number | null;
}

interface Session {
    id: string;
    name: string;
    sample: string;
    operator: string;
    notes: string;
    kind: string;
    created: number;
    bytes: number;
    state: string;
    frames_planned: number;
    frames_committed: number;
    stage: string | null;
    eta_s: number | null;
    activity: Activity | null;
    error: string | null;
    fault: Fault | null;
    has_results: boolean;
    ended?: string | null;
    timing?: { wall_s: number } | null;
    warnings?: string[];
    calibration?: Record<string, { source?: { id: string; taken: number; devices: string[] } } | null> | null;
    // A plan and what a series knows so far differ with the kind of session.
    sigma?: any;
    plan?: any;
}

interface Frame {
    file: string;
    role: string;
    analyser_deg: number | null;
    exposure_s: number;
    gain?: number;
    sequence: number;
    dropped: number;
}

/** A reconstruction; report and options differ with the method. */
interface Upload {
    id: string;
    name: string;
    created: number;
    files: number;
    bytes: number;
    reconstructions: string[];
    expires: number | null;
}

interface Job {
    id: string;
    name: string;
    method: string;
    session: string | null;
    upload: string | null;
    state: "queued" | "running" | "done" | "failed" | "cancelled" | "set_aside";
    progress: number;
    stage: string | null;
    remaining_s: number | null;
    attempts: number;
    created: number;
    error: string | null;
    options?: any;
    light?: LightUpload | null;
    report?: any;
    results?: UsedResult[];
    named?: UsedResult[];
    so_far?: { passes: number; of: number; noise: number | null; seconds_left: number } | null;
}

/** A key of the configuration whose values differ. */
interface SettingsChange {
    key: string;
    from: any;
    to: any;
    at_once: boolean;
}

/** A configuration as text, with its effects. */
interface CheckedSettings {
    text: string;
    values: Record<string, any> | null;
    problem: string | null;
    changes: SettingsChange[];
}

/** The file of the configuration. */
interface SettingsDoc extends CheckedSettings {
    file: string;
    exists: boolean;
    overridden: SettingsChange[];
    backup?: string;
}

/** A result that a job read. */
interface UsedResult {
    id: string;
    name: string;
    session: string | null;
}

/** Where a sheet of an inspection comes from. */
interface SheetOrigin {
    name: string;
    files: { file: string; sha256: string }[];
    devices: string[];
    captured_s: number | null;
}

interface Defect {
    class: string;
    at_px: Point;
    area_px: number;
    area_mm2: number | null;
    size_px: Point;
    size_mm: Point | null;
    deviation: number;
    orientation_deg: number | null;
    polarization: number;
    brightness: number | null;
    period: number | null;
}

interface SheetReport {
    sample: SheetOrigin;
    verdict: "accept" | "reject";
    exceeded: string[];
    defects: Defect[];
    registration: {
        kind: string; likeness: number; turn_deg: number; scale: number; shift_px: Point; shift_mm: Point | null; sigma_px: number; overlap: number;
    };
    offset_deg: number;
    offset_sigma_deg: number;
    differences: Record<string, { rms: number; sigma: number; beyond: number } | null>;
    threshold: number;
    largest_deviation: number;
    size_px: Point;
    pixel_um: number | null;
    warnings: string[];
}

interface InspectionReport {
    reference: SheetOrigin;
    false_alarms: number;
    min_area_px: number;
    limits: { samples: number; threshold: number | null; sheet: Record<string, number | undefined> };
    limits_sha256: string | null;
    trained: boolean;
    sheets: SheetReport[];
    rejected: number;
    warnings: string[];
}

/** A deleted thing that can be restored. */
interface TrashItem {
    id: string;
    kind: "session" | "upload" | "reconstruction";
    name: string;
    deleted: number;
    expires: number;
    files: number;
    bytes: number;
}

/** What a calibration of a camera found. */
interface CalibrationReport {
    rms_px: number | null;
    photographs: { file: string; rms_px: number | null; unused_because: string | null }[];
    warnings: string[];
    light_chi2?: number | null;
    highlights?: { file: string | null; pixel: Point; sigma_px: number; height_mm: number }[];
    band?: { mean_nm: number; sigma_nm: number; fwhm_nm: number };
    geometry: {
        camera: { focal_px: Point; center_px: Point; distortion: number[] };
        sample: { translation_mm: [number, number, number] };
        image_px: Point | null;
        wavelength_nm?: number | null;
        light_mm?: [number, number, number] | null;
        sigma: { light_mm?: [number, number, number] | null; wavelength_nm?: number | null; focal_px?: Point | null; center_px?: Point | null; distortion?: number[] | null; sample_mm?: [number, number, number] | null };
    };
}

/** The newest measurement of the panel. */
interface Measurement {
    state: "none" | "running" | "done" | "failed" | "stopped";
    stage: string;
    progress: number;
    error: string | null;
    found: {
        luminances: number[];
        drift: number;
        law: { gamma: number; gamma_sigma: number; black: number; deviation: number };
        pixels: number;
        exposure_ms: number;
        late_frames: number;
        late_ms: number;
        advice: string[];
    } | null;
}
