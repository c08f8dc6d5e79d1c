# Written by processing/python/generate --update.

"""Types of reports, as in `report.json`."""

from __future__ import annotations

from typing import Any, Literal, Sequence, TypedDict


class AboutInReport(TypedDict, total=False):
    """Summary of maps."""

    width: int
    """Pixels per row."""
    height: int
    """Rows."""
    maps: dict[str, Any]
    """Summary of each map, by name."""


class Alignment(TypedDict, total=False):
    """Shifts between photographs."""

    shifts_px: Sequence[Sequence[float]]
    """Shift of each photograph against the mean of all, in pixels right and down; empty if unknown."""
    sigma_px: float | None
    """Largest standard deviation of a shift, in pixels."""
    corrected: bool
    """Whether the photographs were resampled to correct the shifts."""
    doubt: str | None
    """Reason for which the shifts are unknown."""


class AllDiffers(TypedDict, total=False):
    """Differences by quantity; `None` for a quantity that is unknown in one of the sheets."""

    orientation_deg: Differs | None
    """Orientation in degrees, after the common offset."""
    presence: Differs | None
    """Degree of polarization, which shows the presence of a grating."""
    brightness: Differs | None
    """Logarithm of the brightness, after a smooth background."""
    period: Differs | None
    """Logarithm of the period, after the median."""


class AnalyserCalibration(TypedDict, total=False):
    """Analyser and its stage (`nacre calibrate analyser`): at the stage's angle ψ, the transmission axis is at `zero +
    sense · (ψ + c cos ψ + s sin ψ)`, anticlockwise from the right of the image."""

    source: CalibrationSource | None
    """Origin, for calibrations of a data folder."""
    zero_deg: float
    """Transmission axis at the stage's zero, in degrees."""
    zero_sigma_deg: float
    """Standard deviation of the zero in degrees."""
    sense: int
    """Sense of rotation as seen by the camera: 1 for anticlockwise, -1 for clockwise."""
    eccentricity_deg: Sequence[float]
    """Eccentricity of the stage's scale: the coefficients c and s in degrees."""
    extinction_ratio: float | None
    """Transmission through parallel over crossed polarizers."""


class AnalyserReport(TypedDict, total=False):
    """Report of the operation `analyser`."""

    method: str
    """`analyser`."""
    warnings: Sequence[str]
    """Limitations of the result."""
    zero_deg: Measured
    """Transmission axis at the stage's zero in degrees, anticlockwise from the right of the image."""
    sense: int
    """Sense of rotation as seen by the camera: 1 for anticlockwise, -1 for clockwise."""
    axis_deg: Measured
    """Axis of the reference polarizer in degrees."""
    extinction_ratio: Measured | None
    """Transmission through parallel over crossed polarizers; none if the light of crossed ones is within the noise, or
    if ambient light was not photographed."""
    extinction_at_least: float
    """Lower bound of that ratio (3 standard deviations)."""
    eccentricity: Eccentricity | None
    """Periodic error of the stage's scale; none unless the angles cover a turn."""
    angle_sigma_deg: float
    """Standard deviation of the angles about their scale in degrees."""
    light_sigma: float
    """Standard deviation of the light, as a share."""
    wedge: Wedge | None
    """Image shift of a wedged analyser; none if the photographs show too little structure."""
    region: Sequence[int]
    """Region: left, top, width, height in pixels."""
    angles: Sequence[int]
    """Number of angles of each series."""
    seconds: float
    """Seconds of processing."""


class Band(TypedDict, total=False):
    """A spectral band."""

    mean_nm: float
    """Mean wavelength in nm, weighted by the product of all spectra."""
    sigma_nm: float
    """Standard deviation of the mean in nm: spectrometer scale, and the spectrum of an unmeasured lamp."""
    spread_nm: float
    """Standard deviation of the light about the mean, in nm; it blurs each order."""
    fwhm_nm: float
    """Full width at half maximum in nm."""


class BokehNoiseReport(TypedDict, total=False):
    """Noise model and its source."""

    shot: float
    """Variance per unit of light."""
    floor: float
    """Variance at zero light."""
    source: str
    """`given`, or `estimated` from the photograph."""


class BokehReport(TypedDict, total=False):
    """Results of a bokeh reconstruction."""

    method: str
    """Always `bokeh`."""
    warnings: Sequence[str]
    """Limitations of the result; empty if none is known."""
    photograph: str
    """Description of the photograph."""
    channel: Literal['red', 'green', 'blue', 'luminance']
    """Channel of the photograph."""
    crop: Sequence[int] | None
    """Region of the photograph; `None` for all of it."""
    rotate_deg: float
    """Rotation of the result in degrees, anticlockwise."""
    width: int
    """Width of the result in pixels."""
    height: int
    """Height of the result in pixels."""
    merged: HdrReport | None
    """Report on merging, for a series of exposures."""
    unknown_pixels: int
    """Number of saturated or unknown pixels in the region; their light is extrapolated from their surroundings."""
    psf: str
    """Point spread function: `Gaussian, σ 2.5 px`, or its file."""
    deconvolution: Deconvolution
    """Convergence of the deconvolution."""
    scale: Scale
    """Pixel size on the sample."""
    cutoff: Cutoff | None
    """Resolution limits of the lens; `None` without lens data."""
    slice: SliceReport
    """Position of the slice."""
    lines: LinesReport | None
    """Lines along the slice; `None` if no period is significant."""
    slits: SlitsReport | None
    """Slits fitted to the slice through the photograph before deconvolution; `None` if the fit fails."""
    heights: Heights
    """Height scale."""
    seconds: BokehSeconds
    """Computation times."""


class BokehSeconds(TypedDict, total=False):
    """Computation times in seconds."""

    read: float
    """Reading."""
    deconvolve: float
    """Deconvolution."""
    total: float
    """Total."""


class BrdfChoice(TypedDict, total=False):
    """Chosen method, with the reason."""

    method: Literal['auto', 'reference', 'taylor', 'chebyshev', 'fft', 'nmm', 'pq', 'pq_linear']
    """Method of computation."""
    bits: int
    """Precision in bits."""
    terms: int | None
    """Number of terms or transforms; absent for direct sums."""
    frequencies: int | None
    """Number of spatial frequencies with light."""
    predicted_error: float
    """Predicted largest relative error from expansion, rounding and window, for lobes with at least 0.1 % of the light.
    For `pq`, it applies to lobes as strong as their neighbours."""
    measured_error: float | None
    """Largest relative error, measured against direct sums at some points."""
    predicted_s: float
    """Predicted CPU time in s."""
    why: str
    """Reason for the choice."""


class BrdfReport(TypedDict, total=False):
    """Report of a product: input, method and errors."""

    product: str
    """Name of the product."""
    warnings: Sequence[str]
    """Warnings about the result."""
    input: str
    """File of the height field."""
    quality: Quality
    """Quality of the height field."""
    settings: BrdfSettingsInReport
    """Requested settings."""
    choice: BrdfChoice
    """Method of computation."""
    error_estimate: float
    """Largest relative error of lobes with at least 0.1 % of the light."""
    width: int
    """Pixels per side."""
    albedo: Sequence[float]
    """Reflected fraction of the light within the map's directions, in X, Y, Z."""
    densities: float
    """Number of evaluated densities."""
    seconds: float
    """Time in s."""
    files: Sequence[str]
    """Written files."""


class BrdfSettingsInReport(TypedDict, total=False):
    """Settings of all products."""

    light_deg: Sequence[float]
    """Angle of the light from the normal, and its azimuth anticlockwise from the right, in degrees."""
    method: Literal['auto', 'reference', 'taylor', 'chebyshev', 'fft', 'nmm', 'pq', 'pq_linear']
    """Computation of the power density."""
    order: int | None
    """Highest power of `taylor` (1 to 100), regardless of its error. 1 is the first order of the 2017 paper (section
    6.1), used with its measured heights."""
    coherence_um: float
    """Width of the coherence window in µm: four standard deviations of its amplitude."""
    max_error: float
    """Largest relative error of every lobe with at least 0.1 % of the light."""
    wavelength_step_nm: float | None
    """Step between wavelengths in nm, 0.01 to 100 (2014 thesis, Fig. 6.5). By default, it is as small as each direction
    needs. The error is measured."""
    normalisation: Literal['brdf', 'relative']
    """Normalisation of the result."""
    reflectance: str
    """Reflectance of the smooth surface."""
    shadowing: bool
    """Shadowing and masking of V grooves."""
    illuminant: str
    """Spectrum of the light of a map: a name or a CSV file."""
    observer: Literal['1931', '1964']
    """Observer of a map."""


class CalibrateReport(TypedDict, total=False):
    """Result of a calibration."""

    method: str
    """`calibrate`."""
    geometry: GeometryInReport
    """Calibrated geometry."""
    rms_px: float | None
    """Root mean square reprojection error over all photographs of the board, in px."""
    photographs: Sequence[PhotographReport]
    """Each photograph of the board."""
    sample_rms_px: float | None
    """Root mean square reprojection error of the board on the sample, in px."""
    panel_rms_px: float | None
    """Root mean square reprojection error of the board on the panel, in px."""
    light_chi2: float | None
    """Reduced χ² of the highlights, expected to be 1."""
    warnings: Sequence[str]
    """Limitations of the result."""
    highlights: Sequence[MirrorImage]
    """Mirror images of the light."""
    band: Band | None
    """Spectral band, if spectra are given."""


class Calibration2(TypedDict, total=False):
    """Linear relation of light and height: `height = gain_um · (light / mean light - offset)`."""

    gain_um: float
    """Height in µm per mean light of the photograph, above 0: dark is deep."""
    offset: float
    """Light at height 0, relative to the photograph's mean."""
    rmse_um: float | None
    """Root mean square deviation from the known grating's profile, in µm."""
    grating: KnownGrating | None
    """The known grating of the calibration."""


class CalibrationInReport(TypedDict, total=False):
    """Calibrated properties of a bench. Reconstructions apply the analyser, retarder and orientation of a `frames.json`;
    camera and flat field are stated there by `noise`, `black`, `white` and `flat`."""

    camera: CameraCalibration | None
    """Noise and levels of the camera."""
    flat: FlatCalibration | None
    """Unevenness of light and lens."""
    analyser: AnalyserCalibration | None
    """Zero, sense and extinction of the analyser."""
    retarder: RetarderCalibration | None
    """Polarization behind the retarder of the panel."""
    orientation: OrientationCalibration | None
    """Offset of orientations, from a sample of known orientation."""


class CalibrationSource(TypedDict, total=False):
    """Origin of a calibration in the data folder."""

    id: str
    """Identifier of the calibration."""
    taken: int
    """Time of its photographs in Unix seconds."""
    devices: Sequence[str]
    """Identities of the calibrated devices."""


class Camera(TypedDict, total=False):
    """Camera model: projects directions onto the sensor. Camera coordinates: x right, y down, z forward, origin at the
    entrance pupil. Pixel centres are at integers, row 0 on top. The distortion is Brown's (1966) with OpenCV's order
    of coefficients. With `x = X/Z`, `y = Y/Z`, `s = x² + y²`: `x' = x (1 + k1 s + k2 s² + k3 s³) + 2 p1 x y + p2 (s +
    2x²)`, `y' = y (…) + p1 (s + 2y²) + 2 p2 x y`."""

    focal_px: Sequence[float]
    """Focal length in pixels, horizontally and vertically (1 to 10⁷)."""
    center_px: Sequence[float]
    """Principal point in pixels from the left and from the top (at most 10⁶)."""
    distortion: Sequence[float]
    """Distortion coefficients k1, k2, p1, p2, k3."""


class CameraCalibration(TypedDict, total=False):
    """Noise and levels of a camera (`nacre calibrate camera`)."""

    source: CalibrationSource | None
    """Origin, for calibrations of a data folder."""
    noise: NoiseModel
    """Noise at gain 1."""
    black: float
    """File value without light."""
    white: float
    """File value of a saturated pixel."""
    gain: float
    """Gain of the photographs relative to the camera's base."""
    response: Sequence[float] | None
    """Coefficients of the `transfer` polynomial; absent for a linear camera."""


class CameraReport(TypedDict, total=False):
    """Report of a camera."""

    method: str
    """Always `camera`."""
    warnings: Sequence[str]
    """Limitations of the result."""
    gain_dn_e: Measured
    """Gain K in DN per electron."""
    read_noise_e: Measured
    """Read noise in electrons: temporal noise of darkness without exposure and quantisation."""
    black_dn: float
    """Value without light and exposure in DN."""
    dark_current_e_s: Measured | None
    """Dark current in electrons per second; none for fewer than three dark exposures."""
    full_well_e: float | None
    """Electrons at saturation; none if no photograph is saturated."""
    saturation_dn: float
    """Value at saturation, or the highest one, in DN: the 90th percentile of the brightest exposure."""
    linearity_error: float | None
    """Mean deviation from proportionality to the exposure, as a share; none for fewer than three exposures."""
    chi_square: float
    """Chi-square per degree of freedom of the straight line of variances over means."""
    fitted: int
    """Number of exposures with light that the gain is fitted to."""
    response: CameraResponse | None
    """Response of a nonlinear camera; absent for a linear one. With it, all values in DN are corrected ones: they are
    proportional to light, with the camera's gain at low light."""
    spatial: Spatial
    """Differences between pixels."""
    noise: NoiseModel
    """Noise as a `frames.json` states it, at gain 1."""
    lit: Sequence[Level]
    """Exposures with light."""
    dark: Sequence[Level]
    """Exposures of darkness."""
    seconds: float
    """Computation time in seconds."""


class CameraResponse(TypedDict, total=False):
    """Response of a camera: a value v between black (0) and white (1) is the light v (1 + a v + b v² + c v³), which is v
    at low light."""

    coefficients: Sequence[float]
    """The coefficients a, b and c, as in `"transfer": {"polynomial": …}` of a `frames.json`."""
    black_dn: float
    """File value without light."""
    white_dn: float
    """File value of a saturated pixel."""
    deviation: float
    """Mean deviation of file values from proportionality to the exposure, as a share."""


class CircleCheck(TypedDict, total=False):
    """Circle fitted to the points (S1/S0, S2/S0)."""

    center: Sequence[float]
    """Centre of the best circle; the origin if the model holds."""
    radius: float
    """Radius of the circle."""
    spread: float
    """Scatter of the points about the circle, relative to the radius: the 80 % quantile of the distance over that of a
    normal distribution. It ignores edges and scratches, but not a fifth of the pixels with another period."""
    spread_of_noise: float
    """Scatter expected from noise alone."""
    gap_deg: float
    """Widest gap between points along the circle, in degrees of orientation. Above 60° the circle is unreliable."""
    bias_deg: float | None
    """Mean orientation error caused by an off-centre circle, after the best common offset, in degrees. `None` if the
    points form no ring, so that the centre is undefined."""


class Class(TypedDict, total=False):
    """One class in the report."""

    share: float
    """Share of the pixels with an orientation."""
    dolp: float
    """Median degree of linear polarization."""
    offset_sigma_deg: float
    """Standard deviation of its offset relative to the common offset of all pixels, in degrees; included in σ."""


class ClassLimits(TypedDict, total=False):
    """Limits of the defects of one class."""

    max_count: int | None
    """Largest number of defects."""
    max_area_px: float | None
    """Largest area of one defect in pixels of the reference."""
    max_area_mm2: float | None
    """Largest area of one defect in mm²."""
    max_length_mm: float | None
    """Largest length of one defect in mm."""


class Counts(TypedDict, total=False):
    """Number of pixels by classification."""

    resolved: int
    """Period and orientation are determined."""
    unusable: int
    """Saturated, or not a number."""
    dark: int
    """No light that follows the fringes."""
    no_order: int
    """Mirrored light only: first orders are too weak or out of reach."""
    unexplained: int
    """No single grating explains the light."""
    ambiguous: int
    """Two gratings explain the light."""


class Coverage(TypedDict, total=False):
    """Coverage of the table, as fractions of its entries."""

    mean: float
    """Mean coverage of all entries."""
    full: float
    """Fraction of complete entries (coverage above 0.99)."""
    none: float
    """Fraction of unknown entries (coverage below 0.01), which are NaN."""


class Cutoff(TypedDict, total=False):
    """Resolution limits of a lens."""

    numerical_aperture: float
    """Numerical aperture on the sample side."""
    wavelength_nm: float
    """Wavelength in nm."""
    period_um: float
    """Shortest resolvable period in µm under any illumination: λ / (2 NA), the incoherent limit (Abbe 1873)."""
    coherent_period_um: float
    """Shortest resolvable period in µm under a single distant light on the camera axis: λ / NA, the coherent limit."""


class Deconvolution(TypedDict, total=False):
    """Convergence of the deconvolution."""

    iterations: int
    """Number of iterations."""
    auto: bool
    """True if the stopping rule chose the number."""
    converged: bool
    """True if the stopping rule ended the iterations; always true for a fixed number."""
    accelerated: bool
    """True if the iterations were accelerated."""
    noise: BokehNoiseReport | None
    """Noise model: variance `shot · v + floor` of light `v` (white is 1); `None` with too few known pixels."""
    misfit: float | None
    """Mean squared residual over noise variance, before the last iteration."""
    expected: float | None
    """Expected value of `misfit` for pure noise."""


class Defect(TypedDict, total=False):
    """A defect, in the frame of the reference."""

    at_px: Sequence[float]
    """Centre: column and row of the reference."""
    area_px: float
    """Area in pixels."""
    area_mm2: float | None
    """Area in mm²; `None` if the pixel size is unknown."""
    size_px: Sequence[float]
    """Length and width in pixels: those of the rectangle with the same second moments."""
    size_mm: Sequence[float] | None
    """Length and width in mm."""
    deviation: float
    """Largest difference in standard deviations."""
    false_alarms: float
    """Expected number of such or larger deviations per sheet without defects, for normal noise."""
    orientation_deg: float | None
    """Mean difference of the orientation in degrees; `None` without a grating."""
    polarization: float
    """Degree of polarization relative to the reference."""
    brightness: float | None
    """Brightness relative to the reference; `None` if not known."""
    period: float | None
    """Period relative to the reference; `None` if not measured."""


class Differs(TypedDict, total=False):
    """Differences of one quantity over all compared pixels, defects included."""

    rms: float
    """Root mean square."""
    sigma: float
    """Typical (median) standard deviation of a pixel, noise of both sheets and registration included."""
    beyond: float
    """Share of the pixels that differ by more than three standard deviations."""


class DirectionsReport(TypedDict, total=False):
    """Shared directions of polygons."""

    choice: Literal['auto', 'shared', 'free']
    """`shared` or `free`."""
    why: str
    """Reason for the choice."""
    degrees: Sequence[float]
    """Shared directions in degrees, anticlockwise from the right."""
    um: Sequence[float]
    """Shared periods in µm."""
    areas: int
    """Number of areas whose individual gratings were fitted."""
    agree: float
    """Fraction of these areas that confirm the shared grating, 0 to 1."""
    scatter_deg: float
    """Scatter of areas about the shared directions in degrees."""
    explained: float
    """Fraction of lit positions with a shared grating, 0 to 1."""


class DiscVerification(TypedDict, total=False):
    """Effect of the discs."""

    discs: int
    """Number of photographs of discs."""
    decided: int
    """Number of ambiguous pixels that they decided."""
    contradicted: int
    """Number of pixels masked because discs contradict their grating."""
    residual: float | None
    """Median reduced χ² over the pixels with a grating."""


class Eccentricity(TypedDict, total=False):
    """Periodic error `amplitude · sin(ψ - at)` of the stage's angle ψ."""

    amplitude_deg: float
    """Amplitude in degrees."""
    at_deg: float
    """Angle of the stage at which the error is zero and increases, in degrees."""
    sigma_deg: float
    """Standard deviation of the cosine and sine coefficients in degrees."""


class EnvironmentReport(TypedDict, total=False):
    """Method of rendering a shape's table under environments."""

    shape: str
    """Key of the shape in the scene."""
    method: str
    """`two-pass` or `samples`."""
    why: str
    """Reason for the method."""
    rank: Sequence[int]
    """Largest number of terms per channel of each part of the table, over all tilts."""
    table_error: float
    """Root mean square residual of the table after these terms, relative to the table's root mean square."""
    environment: Sequence[int]
    """Width and height of the filtered environments in pixels."""
    poles: int
    """Number of filtered environments."""
    up_to_deg: float
    """Largest angle of view, in degrees from the normal, at which the filtered environments are used; beyond it samples
    are used."""
    looked_up: float
    """Fraction of the visible shape that uses the filtered environments."""
    measured_error: float
    """Measured root mean square error of the picture against samples of the full integral, relative to its mean
    luminance. It includes truncation, the resolution of the environment, poles and views off the normal, plus two
    standard deviations of the measurement."""


class ErrorReport(TypedDict, total=False):
    """Expected error of a typical orientation after the best common offset, and its terms."""

    noise_deg: float | None
    """Camera noise: the median σ."""
    angle_deg: float | None
    """Random analyser-angle errors: root mean square over the orientations in view."""
    registration_deg: float | None
    """Misregistration of the photographs: median over the pixels."""
    model_deg: float | None
    """Error and uncertainty of the model."""
    total_deg: float | None
    """Total of these terms. Unknown terms count as zero, but without noise or model there is no total."""
    angle_sigma_deg: float | None
    """Standard deviation of the analyser angles behind `angle_deg`."""
    angle_source: Literal['given', 'residuals', 'corrected'] | None
    """Source of that standard deviation."""


class FactorReport(TypedDict, total=False):
    """Report of `nacre factor`."""

    method: str
    """`low-rank`."""
    kind: Literal['singular', 'nonnegative', 'line']
    """Kind of factorisation."""
    size: int
    """Entries along a side of the table."""
    extent: float
    """Largest half-vector component."""
    directions_deg: Sequence[float]
    """Main directions in degrees, the brightest first."""
    contrast: float
    """Maximum over median of the light along lines through the zero order; below 1.3 a pattern has no main direction."""
    pattern: str
    """`two directions`, `one direction`, `radial` or `three directions or more`."""
    parts: Sequence[PartReport]
    """The parts, whose sum is the table."""
    error: float
    """Norm of the residual after all written terms, relative to the table's norm."""
    picture_error_point: float
    """Largest error of a picture: root mean square over all directions, relative to its mean. A single point source has
    this error; environments have a smaller one."""
    picture_error: float | None
    """Error of a picture in the given environment."""
    negative: float | None
    """Most negative radiance in that environment, relative to the largest; it is clamped to 0."""
    separable: bool
    """Whether the rank is low enough that two passes are the fastest method."""
    advice: str
    """Recommended method of environment lighting for this table."""
    warnings: Sequence[str]
    """Limits of the result."""
    assumptions: Sequence[str]
    """Assumptions."""
    seconds: float
    """Computing time in s."""


class FilmReport(TypedDict, total=False):
    """A fitted film. Two ambiguities remain: one offset common to all orientations, and (r, ζ) versus (1/r, -ζ) with all
    orientations rotated by 90°."""

    r: float
    """|R|."""
    zeta_deg: float
    """Phase of R in degrees."""
    retardance_deg: float
    """Retardance (Δn) in degrees."""
    axis_deg: float
    """Azimuth of its axis in degrees."""
    front: float
    """Front reflection: amplitude."""
    front_phase_deg: float
    """Front reflection: phase in degrees."""
    source_error_deg: float
    """Retardance error of the retarder, relative to a quarter wave, in degrees."""
    stray: float
    """Share of unpolarised light."""


class FlashPeriodReport(TypedDict, total=False):
    """Common or individual periods."""

    choice: Literal['auto', 'sample', 'pixel']
    """`sample` or `pixel`."""
    why: str
    """Reason for the choice."""
    um: float | None
    """Common period in µm, if all pixels share one."""
    sigma_um: float | None
    """Standard deviation of `um`."""
    median_um: float | None
    """Median period in µm."""
    range_um: Sequence[float] | None
    """5 % and 95 % quantiles of the period in µm."""
    bic_one: float
    """Bayesian information criterion of one common period (lower is better)."""
    bic_parts: float
    """Bayesian information criterion of one period for each of 6 × 6 parts of the tile."""
    bic_pixels: float
    """Bayesian information criterion of one period per pixel."""
    pixels: int
    """Number of pixels in the decision."""
    largest_part_sigmas: float
    """Largest deviation of a part's period from the common one, in standard deviations."""


class FlashReport(TypedDict, total=False):
    """Report of a reconstruction."""

    method: str
    """Always `flash`."""
    warnings: Sequence[str]
    """Limitations of the results."""
    assumptions: Sequence[str]
    """Unverified assumptions."""
    palette: Literal['cyclic', 'hsv']
    """Colour map of angles in pictures."""
    width: int
    """Width of the maps in pixels."""
    height: int
    """Height of the maps in pixels."""
    pixel_um: float
    """Pixel size on the sheet in µm."""
    tiles: int
    """Number of tiles."""
    reference_mm: Sequence[float]
    """Top left corner of the reference tile, in mm to the right of and above the sheet's centre."""
    registration: Registration | None
    """Registration of the tiles."""
    lights_mm: Sequence[Sequence[float]]
    """Positions of the flash in mm."""
    highlights: Sequence[Sequence[float] | None]
    """Half vector at each highlight, zero for a correct geometry; `None` if the highlight is outside of the picture."""
    light_sigma_mm: float
    """Standard deviation of the light in mm."""
    lobe: float
    """Standard deviation of a lobe over half vectors."""
    spacing: float
    """Typical distance between half vectors of a position's copies, with both signs folded."""
    wavelength_nm: float
    """Wavelength in nm."""
    searched_um: Sequence[float]
    """Searched range of periods in µm."""
    relative: bool
    """True if periods are known only up to a common factor."""
    orientation: Literal['half', 'image']
    """Method of orientation measurement."""
    directions: DirectionsReport
    """Shared directions of polygons."""
    period: FlashPeriodReport
    """Common or individual periods."""
    sigma_deg: float | None
    """Median σ of orientation in degrees; `None` if all pixels are masked."""
    period_sigma: float | None
    """Median relative σ of the period."""
    common_sigma: float
    """Relative σ common to all periods, from wavelength and geometry."""
    masked: Masked
    """Fractions of masked pixels, by reason."""
    seconds: FlashSeconds
    """Computation times."""


class FlashSeconds(TypedDict, total=False):
    """Computation times in seconds."""

    read: float
    """Decoding, registration and copying of tiles."""
    fit: float
    """Fit of gratings."""
    write: float
    """Writing."""
    total: float
    """Total."""


class FlatCalibration(TypedDict, total=False):
    """Unevenness of light and lens (`nacre calibrate flat`)."""

    source: CalibrationSource | None
    """Origin, for calibrations of a data folder."""
    file: str
    """Flat field, relative to the folder of this description."""
    sigma: float
    """Standard deviation of a typical pixel of the flat field, as a share of its value."""


class FlatReport(TypedDict, total=False):
    """Report of the operation `flat`."""

    method: str
    """`flat`."""
    warnings: Sequence[str]
    """Limitations of the result."""
    photographs: int
    """Number of photographs."""
    range: Sequence[float]
    """Light of the darkest and the brightest 1 % of the pixels, relative to the mean."""
    sigma: float
    """Standard deviation of a typical pixel of the flat field, as a share."""
    saturated: float
    """Share of pixels that are saturated in a photograph."""
    seconds: float
    """Seconds of processing."""


class FoilReport(TypedDict, total=False):
    """Summary of the measured distribution, and warnings."""

    bins: Sequence[int]
    """Number of orientation and line-density bins."""
    lines_per_um: Sequence[float]
    """Minimum and maximum line density per µm."""
    period_um: Sequence[float]
    """Mean and standard deviation of the period in µm."""
    relative: bool
    """True if periods are known only up to a common factor."""
    covered: float
    """Fraction of the bins covered by the photograph."""
    background: float
    """Background light relative to the brightest bin."""
    zero_order_px: Sequence[float] | None
    """Measured position of the zero order in pixels."""
    zero_order_off_px: float | None
    """Distance from the expected zero order in pixels."""
    warnings: Sequence[str]
    """Limitations of the result."""
    seconds: float
    """Computation time in seconds."""


class FrameReport(TypedDict, total=False):
    """One exposure."""

    file: str
    """Its file."""
    exposure: float
    """Exposure time · gain, in s."""
    gain: Sequence[float] | None
    """Brightness relative to the other exposures, and its standard deviation; expected to be 1."""


class GeometryInReport(TypedDict, total=False):
    """Positions of camera, sample, panel and light."""

    version: int
    """Version of the format."""
    camera: Camera
    """Camera model."""
    sample: Pose
    """Transform from sample to camera coordinates."""
    panel: Panel | None
    """Panel, if there is one."""
    light_mm: Sequence[float] | None
    """Position of the light (a flash) in sample coordinates, in mm."""
    wavelength_nm: float | None
    """Effective wavelength of the band of light source, filter and camera, in nm."""
    image_px: Sequence[int] | None
    """Width and height in pixels of the photographs to which this geometry applies."""
    relative: bool
    """Whether lengths are known up to a common factor only, with an assumed distortion-free camera. Periods are relative
    then."""
    sigma: Uncertainty
    """Standard deviations."""


class Grating(TypedDict, total=False):
    """Grating of which a patch is a part."""

    period_um: float
    """Period in µm."""
    direction_deg: float
    """Direction of the grating vector in degrees, anticlockwise from the right, 0 to 180."""
    periods: float
    """Number of periods along the grating vector, from corner to corner of the patch."""
    share: float
    """Fraction of the height variance that the grating explains."""


class HdrReport(TypedDict, total=False):
    """Result of merging a bracket."""

    method: str
    """Always `hdr`."""
    warnings: Sequence[str]
    """Limitations of the result; empty if none is known."""
    width: int
    """Pixels of a row."""
    height: int
    """Rows."""
    channels: Sequence[str]
    """Names of the merged channels."""
    frames: Sequence[FrameReport]
    """The exposures."""
    response: str
    """Response: `linear`, `srgb`, `gamma 2.2`, `recovered`, or the file."""
    response_sigma: float | None
    """Largest relative standard deviation of the recovered response between codes 16 and 240."""
    dynamic_range: float | None
    """Ratio of the 99.9 % quantile to the 0.1 % quantile of measured light."""
    samples: Samples
    """Number of samples (pixels times channels)."""
    error_estimate: float | None
    """Median relative standard deviation of measured light, from noise alone."""
    chi2: float | None
    """Reduced χ² of the exposures about the merged light, for the noise of the given or assumed camera; 1 indicates
    agreement."""
    noise: str
    """Source of the noise model: `given`, `estimated` from the scatter of the exposures, or `assumed` (small sensor)."""
    noise_factor: float | None
    """Factor on the assumed camera's shot and read noise (variances) that explains the scatter of the exposures, in
    addition to rounding. `None` if noise is given or undetermined."""
    registration: Alignment | None
    """Registration of the exposures; `None` if disabled."""
    seconds: HdrSeconds
    """Computation times."""


class HdrSeconds(TypedDict, total=False):
    """Computation times in seconds."""

    look: float
    """Analysis of the exposures: response, registration."""
    merge: float
    """Reading and merging."""
    write: float
    """Writing."""
    total: float
    """Total."""


class Heights(TypedDict, total=False):
    """Height scale."""

    unit: str
    """`µm`, or `relative`: 0 and 1 are the 0.1 % and 99.9 % quantiles of the light."""
    mean_light: float
    """Mean light of the result, to which a calibration refers."""
    calibration: Calibration2 | None
    """Calibration that was used or made."""


class Held(TypedDict, total=False):
    """Summary of one map."""

    known_pixels: int
    """Number of unmasked pixels."""
    range: Sequence[float] | None
    """Minimum and maximum value; `None` if all pixels are masked."""


class InspectionReport(TypedDict, total=False):
    """Report of an inspection."""

    method: str
    """Always `inspect`."""
    reference: Origin
    """The reference and its input files."""
    false_alarms: float
    """Accepted false alarms per sheet."""
    min_area_px: int
    """Smallest area of a defect in pixels."""
    limits: Limits
    """The limits applied; of a training, those that it wrote."""
    limits_sha256: str | None
    """SHA-256 of the file of limits; `None` without a file."""
    trained: bool
    """Whether good samples trained limits, and no verdict was made."""
    sheets: Sequence[SheetReport]
    """All sheets, by name."""
    rejected: int
    """Number of rejected sheets."""
    inspected_s: int
    """Time of the inspection in Unix seconds."""
    warnings: Sequence[str]
    """Limitations of the results."""


class KnownGrating(TypedDict, total=False):
    """A grating with a known profile."""

    shape: Literal['sinusoid', 'blazed', 'rectangular']
    """Its shape."""
    depth_um: float
    """Peak-to-peak depth in µm."""


class Level(TypedDict, total=False):
    """Mean and temporal noise of the photographs of one exposure."""

    exposure_s: float
    """Exposure time in s."""
    photographs: int
    """Number of photographs."""
    mean_dn: float
    """Mean value in DN."""
    variance_dn2: float
    """Temporal variance of a pixel in DN²."""
    variance_sigma_dn2: float
    """Standard deviation of `variance_dn2`."""
    unsaturated: float
    """Share of the pixels that are far below saturation; mean and variance are theirs if they are a tenth or more."""
    high_dn: float
    """90th percentile of the values in DN: saturation, where most pixels are saturated."""


class LightReport(TypedDict, total=False):
    """Properties of a light source."""

    center: Sequence[float]
    """Pixel of its photograph that corresponds to the zero order: the given one, or the centroid of the light."""
    scale: float
    """Half vector per pixel of its photograph."""
    pixels: int
    """Number of lit pixels."""
    spread: float
    """Root mean square distance of the light from its centroid, in half vectors."""
    error: float | None
    """Root mean square interpolation error of the table between its entries, relative to its root mean square. Points of
    the source fall between entries."""


class Limits(TypedDict, total=False):
    """Limits of a good sheet. Omitted quantities are not limited."""

    version: int
    """Version of the format."""
    threshold: float | None
    """Smallest difference of a defect in standard deviations; it applies if it exceeds that of normal noise."""
    false_alarms: float | None
    """Accepted false alarms per sheet for which the threshold was trained."""
    samples: int
    """Number of good samples behind the limits; 0 if written by hand."""
    sheet: SheetLimits
    """Limits of the sheet as a whole."""
    defects: dict[str, Any]
    """Limits of defects by class."""


class LinesReport(TypedDict, total=False):
    """Lines along the slice."""

    period_px: Sequence[float]
    """Period along the slice in pixels, and its standard deviation."""
    count: float
    """Number of lines that the slice crosses."""
    amplitude: float
    """Amplitude of the fundamental, in units of light."""
    period_um: float | None
    """Period across the lines in µm, if the pixel size is known."""


class LutChoice(TypedDict, total=False):
    """Selected summation method and its predicted cost."""

    method: str
    """`rays`, `single` or `fixed`."""
    spacing_px: float | None
    """Spacing of rays and samples at the rim, in pixels of the photograph; `None` for `fixed`."""
    step_nm: float | None
    """Spacing of wavelengths in nm; for `fixed` only."""
    predicted_error: float | None
    """Predicted root mean square error at the rim, relative to the root mean square of the table there."""
    predicted_s: float
    """Predicted CPU time in s."""
    why: str
    """Reason for the choice."""


class LutReport(TypedDict, total=False):
    """Result of a lookup-table reconstruction."""

    method: str
    """Always `lut`."""
    warnings: Sequence[str]
    """Limitations of the result; empty if none is known."""
    assumptions: Sequence[str]
    """Unverifiable assumptions; the errors below do not include their effect."""
    width: int
    """Width of the table in entries."""
    height: int
    """Height of the table in entries."""
    extent: float
    """Largest component of the half vector."""
    warp: int
    """Exponent of the warp."""
    wavelength_nm: float | Sequence[float]
    """Wavelength of the photograph in nm."""
    illuminant: str
    """Illuminant."""
    observer: Literal['1931', '1964']
    """Standard observer."""
    exponent: float
    """Exponent of λm/λ."""
    scale: float
    """Half vector per pixel of the photograph, or of the resampled photograph if a geometry was given."""
    center: Sequence[float]
    """Position of the zero order in pixels from the left and the top of the photograph, before resampling."""
    center_sigma_px: float | None
    """Standard deviation of `center` in pixels, or the distance between a given position and the nearby lobe."""
    choice: LutChoice
    """Summation method and the reason for it."""
    error_estimate: float | None
    """Combined error: root mean square of Y at the rim (a half-vector component above 0.6 of the extent), relative to
    the table's root mean square there."""
    sum_error: float | None
    """Summation error: sums against finer sums of the same photograph, at the rim or anywhere, whichever is larger."""
    sampling_error: float | None
    """Interpolation error between the photograph's pixels, from structure finer than a pixel and from noise."""
    center_error: float | None
    """Error due to the uncertainty of the zero order's position."""
    light: LightReport | None
    """Properties of the extended source, if its photograph was given."""
    band_px: float | None
    """Blur of an order at the rim due to the filter's bandwidth: full width at half maximum in pixels of the photograph."""
    coverage: Coverage
    """Coverage of the entries."""
    merged: HdrReport | None
    """Report on merging the exposures, if any."""
    seconds: LutSeconds
    """Computation times."""


class LutSeconds(TypedDict, total=False):
    """Computation times in seconds."""

    read: float
    """Reading, and merging of exposures."""
    table: float
    """Summation."""
    write: float
    """Writing."""
    total: float
    """Total."""


class MapOptionsInReport(TypedDict, total=False):
    """Edit maps of orientation and period, in the order of these options."""

    rotate_deg: float | None
    """Rotation of image and orientations in degrees, anticlockwise; multiples of 90 are exact."""
    resample: float | None
    """Scale factor of the number of pixels along each axis."""
    tile: Sequence[int] | None
    """Number of copies along a row and a column."""
    size: Sequence[int] | None
    """Width and height in pixels; crops, or fills with further copies."""
    layout: Literal['repeat', 'mirror', 'brick']
    """Arrangement of copies."""
    orientation_offset_deg: float | None
    """Rotation of orientations alone in degrees, anticlockwise."""
    period: PeriodCurveQuadratic | PeriodCurveSineSquared | PeriodCurveTable | None
    """Periods as a function of orientation: from the first at 0° to the second at 180° in µm, or rows of
    orientation_deg,period_um. Replaces existing periods."""
    scale: float | None
    """Scale factor of periods."""
    offset_um: float | None
    """Offset of periods in µm."""
    clamp_um: Sequence[float] | None
    """Minimum and maximum period in µm; other values are clamped."""


class MapReport(TypedDict, total=False):
    """Report of an edit."""

    method: str
    """`map`."""
    edits: MapOptionsInReport
    """The edits."""
    palette: Literal['cyclic', 'hsv']
    """Colour map of angles in the picture."""
    before: AboutInReport
    """Maps before the edit."""
    after: AboutInReport
    """Maps after the edit."""
    warnings: Sequence[str]
    """Limitations of the result."""


class Masked(TypedDict, total=False):
    """Fractions of pixels, 0 to 1."""

    all: float
    """All masked pixels."""
    unseen: float
    """In no photograph."""
    dark: float
    """Without diffracted light."""
    ambiguous: float
    """Several gratings fit, or the order is ambiguous."""
    several: float
    """Several gratings in one pixel."""
    uncertain: float
    """Too few copies near a lobe."""
    unexplained: float
    """No grating fits."""


class Material(TypedDict, total=False):
    """Materials of the sample: a transparent film on metal."""

    film_index: float
    """Refractive index of the film; 1 for bare metal."""
    metal_n: float
    """Refractive index of the metal."""
    metal_k: float
    """Extinction coefficient of the metal."""


class Measured(TypedDict, total=False):
    """A value and its standard deviation."""

    value: float
    """The value."""
    sigma: float
    """Its standard deviation."""


class MirrorImage(TypedDict, total=False):
    """Position of a mirror image."""

    file: str | None
    """Photograph, if the mirror image was detected in one."""
    pixel: Sequence[float]
    """Pixels from the left and the top."""
    sigma_px: float
    """Standard deviation in px."""
    height_mm: float
    """Height of the mirror in mm."""


class ModelReport(TypedDict, total=False):
    """A candidate in the report."""

    model: str
    """Name; for curves with the parameters fitted beyond the film."""
    parameters: int
    """Number of parameters."""
    behind: float
    """Penalised −2 ln likelihood relative to the best model: 0 for the best, 10 for one that is 150 times less likely."""
    scatter: float
    """Scatter of the points about the curve relative to their noise, as a ratio of standard deviations; 1 for a perfect
    model."""
    difference_deg: float
    """68 % quantile of the orientation differences from the selected model, in degrees."""
    uncertain_deg: float
    """Error caused by the uncertainty of its parameters, in degrees."""
    center: Sequence[float] | None
    """Centre of the circle."""
    film: FilmReport | None
    """The film, for curves."""


class NoiseModel(TypedDict, total=False):
    """Noise of a linear sensor at gain 1. A sensor value `v` (0 at black, 1 at white) has the variance `v/F + (r/F)² +
    q²/12`, with F electrons at white, read noise r in electrons, and quantisation step q."""

    full_scale_e: float
    """Electrons per pixel at white and gain 1 (full-well capacity)."""
    read_noise_e: float
    """Read noise in electrons (standard deviation)."""


class Notes(TypedDict, total=False):
    """Notes on the computation of a material."""

    method: str
    """Description of the method."""
    orders: int | None
    """Highest order."""
    predicted_error: float
    """Predicted relative error of its model."""
    theory_error: float | None
    """Approximate share of a grating's light that balanced scalar theory places in a wrong order, at 45°, compared with
    rigorous solutions for a perfect conductor. Sampling does not reduce it, so it is excluded from the target error."""
    warnings: Sequence[str]
    """Warnings."""


class ObliqueReport(TypedDict, total=False):
    """Report of the oblique-incidence correction."""

    largest_deg: float
    """Largest angle of incidence in the photographs, in degrees."""
    asked: bool
    """Whether the correction was requested."""
    corrected: bool
    """Whether the correction was applied."""
    left_deg: float
    """Remaining error of a typical orientation in degrees; part of the model's error."""
    material: Material
    """Assumed material."""
    scatter: Sequence[float] | None
    """Scatter of the points about the curve relative to their noise, without and with the correction; `None` if it was
    not tried."""
    gain: float | None
    """Decrease of −2 ln likelihood by the correction, on the points used for model comparison."""


class OrientationCalibration(TypedDict, total=False):
    """Offset of orientations, from a sample of known orientation (`nacre calibrate orientation`)."""

    source: CalibrationSource | None
    """Origin, for calibrations of a data folder."""
    offset_deg: float
    """Offset in degrees to add to orientations."""
    sigma_deg: float
    """Standard deviation of the offset in degrees."""
    model: str
    """Grating model of the measurement; the offset of another model differs."""


class OrientationReport(TypedDict, total=False):
    """Report of the operation `orientation`."""

    method: str
    """`orientation`."""
    warnings: Sequence[str]
    """Limitations of the result."""
    offset_deg: Measured
    """Offset to add to orientations in degrees."""
    spread_deg: float
    """Standard deviation of the differences from the known orientations in degrees."""
    pixels: int
    """Number of pixels."""
    model: str
    """Grating model of the map."""
    seconds: float
    """Seconds of processing."""


class Origin(TypedDict, total=False):
    """Where a sheet comes from."""

    name: str
    """Name of its folder or file."""
    files: Sequence[Signature]
    """Files that were read."""
    devices: Sequence[str]
    """Devices with serial numbers; empty if no session states them."""
    captured_s: int | None
    """Time of the capture in Unix seconds; `None` if no session states it."""
    measured: bool
    """Whether the maps have standard deviations; those of a design are exact."""


class Panel(TypedDict, total=False):
    """Flat display."""

    pose: Pose
    """Transform from panel to sample coordinates."""
    pixel_mm: Sequence[float]
    """Width and height of a pixel, in mm."""
    size_px: Sequence[int]
    """Number of pixels per row and per column."""


class PartReport(TypedDict, total=False):
    """One straightened part."""

    directions_deg: Sequence[float]
    """Directions across and along the meridian in degrees, anticlockwise from the table's right."""
    rank: int
    """Terms of each channel."""
    error: Sequence[float]
    """Residual norm of red, green and blue, relative to the part's norm."""
    singular_values: Sequence[float]
    """Largest singular values of green, relative to the first."""
    files: Sequence[str]
    """Files of the curves."""


class Peak(TypedDict, total=False):
    """Peak of the spatial spectrum."""

    period_um: float
    """Period in µm."""
    resolution_um: float
    """Half the difference of two periods that a patch of this size can resolve, in µm."""
    direction_deg: float
    """Direction of the grating vector in degrees, anticlockwise from the right, 0 to 180."""
    share: float
    """Fraction of the height variance."""


class PeriodCurveQuadratic(TypedDict, total=False):
    """`min + (max - min) (θ/π)²` (2018 paper, section 6.4, Fig. 22a): both in µm."""

    quadratic: Sequence[float]


class PeriodCurveSineSquared(TypedDict, total=False):
    """`min + (max - min) sin²(θ/2)` in µm, from min at 0° to max at 180° (2018 paper, Fig. 22b)."""

    sine_squared: Sequence[float]


class PeriodCurveTable(TypedDict, total=False):
    """Rows of orientation in degrees, increasing, and period in µm; linear interpolation, undefined outside."""

    table: Sequence[Sequence[float]]


class PeriodMethodFrom(TypedDict, total=False):
    """From the degree of linear polarization by rigorous diffraction, for an assumed surface."""

    range_um: Sequence[float]
    """Range in µm that must contain all periods."""
    depth_um: float
    """Assumed peak-to-peak depth of the grating in µm."""
    metal: str
    """Assumed metal."""
    index_above: float
    """Refractive index of the medium above the metal."""
    wavelength_nm: float | None
    """Vacuum wavelength in nm; default: that of the photographs."""


class PhotographReport(TypedDict, total=False):
    """A photograph of the board."""

    file: str
    """File name."""
    rms_px: float | None
    """Root mean square reprojection error in px."""
    unused_because: str | None
    """Reason for rejection."""


class PixelResidual(TypedDict, total=False):
    """Residual of a pixel."""

    x: int
    """Column, from the left."""
    y: int
    """Row, from the top."""
    residual: float
    """Reduced χ²."""


class Pixels(TypedDict, total=False):
    """Number and quality of pixels with an orientation."""

    all: int
    """All pixels of the map."""
    valid: int
    """Pixels with an orientation."""
    saturated: int
    """Masked: saturated or not finite in at least one photograph."""
    without_grating: int
    """Masked: metal without a grating, as identified by the model."""
    too_little_modulation: int
    """Masked: modulation below the noise limit."""
    sigma_median_deg: float | None
    """Median σ of the orientation over valid pixels."""
    sigma_p90_deg: float | None
    """90th percentile of σ over valid pixels."""
    correlation_mean: float | None
    """Mean normalised correlation between fit and measurement over valid pixels."""


class PolarizationNoiseReport(TypedDict, total=False):
    """Noise of an average frame: variance = `shot` · I + `floor`, in linear units."""

    source: Literal['given', 'repeats', 'estimated', 'assumed']
    """Source of the noise model."""
    shot: float
    """Variance per unit of intensity."""
    floor: float
    """Variance at zero intensity."""


class PolarizationPeriodReport(TypedDict, total=False):
    """Report of the period map."""

    method: PeriodMethodFrom
    """The requested method, with all its assumptions."""
    heuristic: bool
    """Whether the periods are heuristic: only their order is meaningful."""
    unique_um: Sequence[Sequence[float]]
    """Ranges of period in µm that the polarization determines uniquely, under the assumptions; empty for heuristic
    periods."""
    valid: int
    """Pixels with a period."""
    ambiguous: int
    """Pixels with an orientation but without a period, since no period or several in the range correspond to their
    polarization."""
    median_um: float | None
    """Median period in µm."""
    sigma_median_um: float | None
    """Median σ of the period in µm, due to noise."""
    if_depth_is_off: Sequence[float | None] | None
    """Relative error of the median period if the true depth is 10 % smaller, and 10 % larger, than assumed; null where
    no period would be found."""


class PolarizationReport(TypedDict, total=False):
    """Result of a polarization reconstruction, as text and numbers."""

    method: str
    """Always `polarization`."""
    model: str
    """The model used."""
    model_reason: str
    """Reason for the model."""
    warnings: Sequence[str]
    """Warnings about the map; empty if there are none."""
    width: int
    """Width of the map in pixels."""
    height: int
    """Height of the map in pixels."""
    sensor: SensorReport | None
    """Origin of the maps in frames of a polarization sensor; `None` for other photographs."""
    pixels: Pixels
    """Pixel counts and quality."""
    noise: PolarizationNoiseReport
    """The noise model behind σ."""
    error_estimate_deg: float | None
    """Expected error of a typical orientation: the total of the terms below. `None` if the model's error is unknown, or
    for errors that cannot be expressed in degrees."""
    error: ErrorReport
    """Terms of that error."""
    models: Sequence[ModelReport]
    """All fitted models, simplest first; empty if too few pixels have modulation."""
    classes: Sequence[Class]
    """Classes of pixels that differ in their degree of polarization, as for gratings of several periods or depths; empty
    for a single class."""
    circle: CircleCheck | None
    """Test of the sinusoid model."""
    brackets: int
    """Number of analyser positions with merged exposures."""
    registration: Alignment | None
    """Relative shifts of the photographs, one entry for each analyser position; `None` for a sensor that takes all
    angles at once, and for more than 24 positions."""
    repeats: RepeatsReport | None
    """Results from views at equal angles or angles 180° apart; `None` if fewer than three angles are repeated."""
    smoothing: SmoothingReport
    """Smoothing of orientations, in pictures or also in the map."""
    period: PolarizationPeriodReport | None
    """Report of the period map, if requested."""
    oblique: ObliqueReport | None
    """Correction of oblique incidence; `None` if the camera geometry is unknown."""
    palette: Literal['cyclic', 'hsv']
    """Colour map of angles in pictures."""
    offset_deg: float
    """Offset added to all orientations in degrees. The method determines orientations only up to a common offset."""
    absolute_error_deg: float | None
    """Expected error of a typical absolute orientation, including the calibrated offset. `None` without a calibrated
    offset: orientations are then relative."""
    calibration: CalibrationInReport | None
    """Calibration of the bench that was applied."""
    analyser_errors_deg: Sequence[float] | None
    """Analyser-angle error of each position in degrees, with zero mean: estimated from residuals and corrected. `None`
    if a correction is not worthwhile or the errors are unobservable."""
    analyser_deg: Sequence[float]
    """Stated analyser angles in the order of the frames."""
    condition: float
    """Condition number of the angle set; √2 is optimal."""
    frames: Sequence[str]
    """Files used, in order."""
    seconds: PolarizationSeconds
    """Wall time per stage in s."""


class PolarizationSeconds(TypedDict, total=False):
    """Wall time in seconds."""

    read_and_fit: float
    """Decoding the photographs and adding them to the fit, including a second pass for registration or angle correction."""
    solve: float
    """Solving, noise, orientation, checks."""
    write: float
    """Writing maps and pictures."""
    total: float
    """Total."""


class PolarizationVerification(TypedDict, total=False):
    """Effect of a polarization map."""

    offset_deg: float
    """Offset to add to its orientations, in degrees; varies with the period if periods are mixed."""
    spread_deg: float
    """Median absolute deviation from the offset in degrees, over pixels with both."""
    shared: int
    """Number of pixels with both."""
    contradicted: int
    """Number of masked pixels, where both differ by more than ten combined σ and 5°."""
    decided: int
    """Number of ambiguous pixels that it decided."""


class Pose(TypedDict, total=False):
    """Rigid transform `q = R p + t`."""

    rotation: Sequence[Sequence[float]]
    """Rotation matrix R, row by row."""
    translation_mm: Sequence[float]
    """Translation t in mm."""


class Prediction(TypedDict, total=False):
    """Predicted passes, noise and time."""

    passes: int
    """Number of passes required by the target error, or permitted by the sample limit."""
    noise: float
    """Expected error after these passes."""
    seconds: float
    """Expected time in s."""


class Quality(TypedDict, total=False):
    """Contents of a height field, and its quality for diffraction."""

    width: int
    """Pixels per row."""
    height: int
    """Number of rows."""
    pixel_um: float
    """Pixel pitch in µm."""
    size_um: Sequence[float]
    """Width and height in µm."""
    range_um: float
    """Height range: highest minus lowest point, in µm."""
    rms_um: float
    """Standard deviation of the heights in µm."""
    rms_slope: float
    """Root mean square slope between neighbours."""
    tilt: Sequence[float]
    """Slopes to the right and up of the best-fitting plane."""
    periods: Sequence[Peak]
    """Peaks of the spatial spectrum, strongest first."""
    grating: Grating | None
    """Grating of which the patch is a part, if there is only one."""
    seams: Sequence[float]
    """Steps (or changes of slope) from the last to the first column and row, relative to the largest between neighbours
    inside. Above 1.25 the repeated patch has visible seams."""
    shortest_nm: float
    """Shortest wavelength in nm whose orders the pitch can carry, over all viewing directions at normal incidence."""
    step_um: float | None
    """Height resolution of the file in µm."""
    notes: Sequence[str]
    """Notes on reading the file: format, channel, encoding."""
    warnings: Sequence[str]
    """Warnings about the patch."""


class Registration(TypedDict, total=False):
    """Registration of the tiles."""

    most_px: float
    """Largest displacement of a tile in map pixels."""
    sigma_px: float
    """Typical σ of a tile's position in pixels."""
    left_out: int
    """Number of rejected tiles, which resemble no other."""


class Registration2(TypedDict, total=False):
    """Registration of the sample to the reference."""

    kind: str
    """`similarity`, `homography` or `smooth`: the simplest transform that fits."""
    likeness: float
    """Correlation at the first registration, 0 to 1."""
    turn_deg: float
    """Turn of the sheet in degrees, anticlockwise."""
    scale: float
    """Size of the sample relative to the reference, in pixels."""
    shift_px: Sequence[float]
    """Shift of the middle in pixels, right and down."""
    shift_mm: Sequence[float] | None
    """Shift in mm; `None` if the pixel size is unknown."""
    sigma_px: float
    """Standard deviation of the shift in pixels."""
    smooth_px: float
    """Largest displacement by the smooth part in pixels."""
    edge: float
    """Residuals at edges relative to the contrast within a pixel: errors of sampling and registration."""
    overlap: float
    """Share of the reference that is seen in the sample."""


class RenderOptionsInReport(TypedDict, total=False):
    """Render a scene."""

    samples: int
    """Largest number of samples per pixel, averaged over lit pixels. Half of the samples are distributed by noise."""
    max_error: float
    """Target error: root mean square of the pixels' standard errors, relative to the mean luminance."""
    wavelengths: int | None
    """Fixed number of wavelengths, evenly spaced in 1/λ; default: as many as each surface point needs."""
    check: bool
    """Also measure the truncation error of the sums over orders and wavelengths."""
    spectral_nm: float | None
    """Spacing of spectral bands in nm (1 to 100) for a spectrum per pixel, stored as EXR channels S0.550,000000nm and so
    on."""
    method: Literal['auto', 'samples', 'two-pass']
    """Method for lookup tables under environments: auto is the cheapest that meets the target error."""
    rank: int | None
    """Largest number of terms per channel and part of a table in two passes (1 to 96); default: as many as the error
    requires."""
    scene: str | None
    """Text of a scene (TOML) that replaces the scene of the folder, beside the same files."""


class RenderReport(TypedDict, total=False):
    """A report with the requested options."""

    method: str
    """Description of the method."""
    device: str
    """The graphics card, or "processor"."""
    size: Sequence[int]
    """Width and height in pixels."""
    samples: int
    """Samples per pixel, averaged over lit pixels."""
    noise: float
    """Root mean square of the pixels' standard errors, relative to the mean luminance."""
    predicted_model_error: float
    """Truncation error of sums over orders and wavelengths, estimated with finer sums at some pixels: root mean square
    relative to their mean luminance."""
    measured_model_error: float | None
    """Truncation error, measured against much finer sums at more pixels."""
    spectral: SpectralReport | None
    """Properties of the spectra, if requested."""
    predicted: Prediction
    """Prediction before the first pass."""
    materials: dict[str, Any]
    """Method of each material."""
    environments: Sequence[EnvironmentReport]
    """Shapes whose tables are rendered, or could be rendered, by two passes under environments."""
    hints: Sequence[str]
    """Defaults that determine the picture and are not stated in the scene."""
    warnings: Sequence[str]
    """Warnings."""
    assumptions: Sequence[str]
    """Assumptions of the model."""
    seconds: float
    """Total time in s."""
    seconds_of_passes: float
    """Time of the passes in s."""
    files: Sequence[str]
    """Written files."""
    settings: RenderOptionsInReport
    """Render a scene."""
    exposure: float
    """Factor from linear radiance to the PNG."""


class RepeatsReport(TypedDict, total=False):
    """Results from repeated views."""

    pairs: int
    """Number of pairs of views at angles equal modulo 180°."""
    gain: Sequence[float]
    """Brightness of the second view of each pair relative to the first."""
    pixels: int
    """Pixels on which both halves of the series were compared; noise is calibrated on other pixels."""
    offset_deg: float
    """Median over these pixels of the polarization angle of the second half minus that of the first, in degrees."""
    difference_deg: float
    """Root mean square of that difference, in degrees."""
    expected_deg: float
    """Its expected value from the σ of both halves, in degrees."""
    chi2: float
    """Reduced χ²: the mean squared difference over the sum of both σ²; 1 for a correct σ."""
    chi2_median: float
    """Reduced χ² from the median, which is robust against dust and edges."""


class Response(TypedDict, total=False):
    """Power law of the panel's light. The exponent differs from 1 if the panel's gamma was not corrected exactly."""

    power: float
    """Exponent."""
    measured: bool
    """True if measured from frames of uniform light, otherwise assumed."""
    misfit: float
    """Largest deviation of uniform frames from the power law, relative to white."""


class RetarderCalibration(TypedDict, total=False):
    """Polarization of the panel behind its retarder (`nacre calibrate retarder`)."""

    source: CalibrationSource | None
    """Origin, for calibrations of a data folder."""
    panel_deg: float
    """Direction of the panel's linear polarization in degrees."""
    azimuth_deg: float
    """Direction of the retarder's axis in degrees."""
    azimuth_sigma_deg: float
    """Standard deviation of the azimuth in degrees."""
    retardance_deg: float
    """Retardance in degrees at the wavelength of the photographs."""
    retardance_sigma_deg: float
    """Standard deviation of the retardance in degrees."""


class RetarderReport(TypedDict, total=False):
    """Report of the operation `retarder`."""

    method: str
    """`retarder`."""
    warnings: Sequence[str]
    """Limitations of the result."""
    panel_deg: Measured
    """Direction of the panel's linear polarization in degrees."""
    azimuth_deg: Measured
    """Direction of the retarder's axis in degrees."""
    retardance_deg: Measured
    """Retardance in degrees at the wavelength of the photographs."""
    wavelength_nm: float | None
    """Wavelength in nm, if the photographs state it."""
    stokes: Sequence[Measured]
    """S1/S0 and S2/S0 behind the retarder."""
    panel_contrast: float | None
    """Contrast of the panel without retarder; none if its direction is stated."""
    region: Sequence[int]
    """Region: left, top, width, height in pixels."""
    seconds: float
    """Seconds of processing."""


class Samples(TypedDict, total=False):
    """Number of samples."""

    all: int
    """All."""
    saturated: int
    """Saturated in all exposures: unknown, NaN."""
    dark: int
    """Less than three standard deviations above black in the merged light."""


class Scale(TypedDict, total=False):
    """Pixel size on the sample."""

    pixel_um: float | None
    """Pixel size in µm; `None` if unknown."""
    sigma_um: float | None
    """Standard deviation of the pixel size in µm, from counted lines."""
    source: str
    """Source of the pixel size: `given`, `counted lines` or `unknown`."""


class SensorReport(TypedDict, total=False):
    """Origin of the maps in frames of a polarization sensor."""

    superpixel_px: int
    """Pixels along the side of the sensor's super-pixel: 2, or 4 with colour filters."""
    map_pixel_px: int
    """Sensor pixels along the side of a map pixel: that of a super-pixel, or 1 for interpolated images."""
    channel: Literal['r', 'g', 'b', 'luminance'] | None
    """Colour channel used, for colour sensors; several pixels of it in a super-pixel were averaged."""
    demosaic: Literal['none', 'bilinear', 'edge-aware']
    """Interpolation of the images behind each polarizer."""


class SheetLimits(TypedDict, total=False):
    """Limits of differences over the whole sheet."""

    min_overlap: float | None
    """Smallest share of the reference that the sample must show."""
    max_orientation_deg: float | None
    """Largest root mean square difference of orientations in degrees."""
    max_presence: float | None
    """Largest root mean square difference of the degree of polarization."""
    max_brightness: float | None
    """Largest root mean square difference of the logarithm of the brightness."""
    max_period: float | None
    """Largest root mean square difference of the logarithm of the period."""


class SheetReport(TypedDict, total=False):
    """Inspection of one sheet."""

    sample: Origin
    """The sheet and its input files."""
    verdict: Literal['accept', 'reject']
    """Verdict by the limits."""
    exceeded: Sequence[str]
    """Limits that are exceeded."""
    defects: Sequence[Defect]
    """Defects, largest difference first."""
    registration: Registration2
    """Registration to the reference."""
    offset_deg: float
    """Offset of all orientations from those of the reference in degrees, without the turn of the sheet."""
    offset_sigma_deg: float
    """Standard deviation of the offset in degrees."""
    differences: AllDiffers
    """Differences by quantity."""
    threshold: float
    """Smallest difference of a defect in standard deviations."""
    largest_deviation: float
    """Largest difference of any region in standard deviations."""
    size_px: Sequence[int]
    """Width and height of the reference in pixels."""
    pixel_um: float | None
    """Size of a pixel of the reference in µm; `None` if unknown."""
    warnings: Sequence[str]
    """Limitations of the inspection."""


class Signature(TypedDict, total=False):
    """A file of the input and its hash."""

    file: str
    """File name."""
    sha256: str
    """SHA-256 of its bytes, in hexadecimal digits."""


class SliceReport(TypedDict, total=False):
    """Position of the slice."""

    line: Sequence[float]
    """End points in pixels of the result."""
    width_px: int
    """Width in pixels over which each sample is averaged."""
    tilt_deg: float
    """Angle in degrees from the slice to the grating vector, anticlockwise."""


class SlitsReport(TypedDict, total=False):
    """Slits along the slice."""

    count: int
    """Number of bright slits whose centre lies in the slice and is more than half bright."""
    spacing_px: Sequence[float]
    """Distance of adjacent slits."""
    width_px: Sequence[float]
    """Full width of a slit at half maximum."""
    softness_px: Sequence[float]
    """Standard deviation of the Gaussian blur of the edges."""
    light: Sequence[float]
    """Light between slits and in slits."""
    residual: float
    """Root mean square residual relative to the difference of these two."""
    spacing_um: Sequence[float] | None
    """Spacing across the slits in µm and its standard deviation, if the pixel size is known."""
    width_um: Sequence[float] | None
    """Slit width in µm and its standard deviation, if the pixel size is known."""


class SmoothingReport(TypedDict, total=False):
    """Smoothing of orientations."""

    strength: str
    """`none`, `light`, `strong` or a number of iterations."""
    rounds: int
    """Number of filter iterations."""
    space_sigma_px: float
    """Standard deviation of the spatial weight of one iteration, in pixels."""
    map: bool
    """Whether `orientation.exr` and its σ are smoothed as well; all numbers here are then those of the smoothed map."""
    exr: bool
    """Whether `smoothed.exr` was written."""


class Spatial(TypedDict, total=False):
    """Differences between pixels."""

    dsnu_e: float
    """Standard deviation of the dark values in electrons, at the longest exposure (DSNU)."""
    prnu: float
    """Standard deviation of the response as a share, at half of the saturation (PRNU)."""
    bad_pixels: int
    """Number of pixels that differ far more."""


class SpectralReport(TypedDict, total=False):
    """Report of the spectra."""

    range_nm: Sequence[float]
    """Centres of the first and last band in nm."""
    step_nm: float
    """Spacing of the bands in nm."""
    bands: int
    """Number of bands."""
    samples: int
    """Maximum number of samples per pixel for three bands at a time."""
    noise: float | None
    """Largest noise over groups of three bands: root mean square of the standard errors of their mean, relative to the
    mean; `None` after a single pass."""
    seconds: float
    """Computing time in s."""


class SpotsReport(TypedDict, total=False):
    """Result of a fringe reconstruction."""

    method: str
    """Always `spots`."""
    warnings: Sequence[str]
    """Limitations of the result; empty if none is known."""
    assumptions: Sequence[str]
    """Unverified assumptions."""
    palette: Literal['cyclic', 'hsv']
    """Colour map of angles in pictures."""
    width: int
    """Pixels per row."""
    height: int
    """Rows."""
    fringes: int
    """Number of different fringes."""
    patterns: int
    """Number of frames with fringes or uniform light."""
    wavelength_nm: float
    """Effective wavelength in nm."""
    periods_um: Sequence[float]
    """Searched range of periods in µm."""
    shortest_um: Sequence[float | None]
    """Shortest period in µm whose first order reaches the panel from the sample's centre, for grating vectors at 0, 15,
    … 165 degrees; `None` where none does."""
    pixels: Counts
    """Number of pixels by classification."""
    orientation_sigma_deg: float | None
    """Median σ of the orientation in degrees."""
    period_sigma: float | None
    """Median relative σ of the period, without common errors."""
    period_scale_sigma: float
    """Relative σ common to all periods, from wavelength and geometry."""
    orientation_common_sigma_deg: float
    """Standard deviation common to all orientations, in degrees, from the geometry. The maps' σ include both common
    errors."""
    mirror_offset_deg: Sequence[float] | None
    """Median deviation of the mirror direction from that of the geometry, in degrees to the right and upwards. Indicates
    a wrong geometry or a tilted sample."""
    residual: float | None
    """Median reduced χ²."""
    worst: Sequence[PixelResidual]
    """Pixels with the largest reduced χ² among those resolved, at most ten, largest first."""
    aperture_mm: float
    """Estimated or given diameter of the aperture in mm."""
    response: Response
    """Response of the panel."""
    discs: DiscVerification | None
    """Effect of disc photographs, if there are at least four."""
    polarization: PolarizationVerification | None
    """Effect of the polarization map, if given."""
    seconds: SpotsSeconds
    """Computation times."""


class SpotsSeconds(TypedDict, total=False):
    """Computation times in seconds."""

    read: float
    """Reading and demodulation."""
    calibrate: float
    """Estimation of the aperture."""
    solve: float
    """Identification of the orders."""
    write: float
    """Writing."""
    total: float
    """Total."""


class StackReport(TypedDict, total=False):
    """Report of a stack."""

    method: str
    """Always `stack`."""
    warnings: Sequence[str]
    """Limitations of the result."""
    width: int
    """Pixels of a row."""
    height: int
    """Rows."""
    channels: int
    """Channels of the photographs."""
    photographs: int
    """Number of photographs."""
    rejected: float
    """Fraction of rejected values."""
    sigma: float | None
    """Median standard deviation of one photograph, in file units."""
    error_estimate: float | None
    """Measured standard error of a typical mean, in file units."""
    seconds: float
    """Computation time in seconds."""


class SynthesizeReport(TypedDict, total=False):
    """Report of synthesized maps."""

    dots: int
    """Number of drawn dots."""
    total_variation: Sequence[float]
    """Total variation distance between distribution and map, by area: orientation, and period."""
    expected: Sequence[float]
    """Expected total variation for this number of dots."""
    bare: float
    """Fraction of the map without a dot."""
    warnings: Sequence[str]
    """Limitations of the result."""
    palette: Literal['cyclic', 'hsv']
    """Colour map of the picture."""


class Uncertainty(TypedDict, total=False):
    """Standard deviations; an absent value is unknown, not zero."""

    focal_px: Sequence[float] | None
    """Focal lengths, in pixels."""
    center_px: Sequence[float] | None
    """Principal point, in pixels."""
    distortion: Sequence[float] | None
    """Distortion coefficients."""
    sample_turn_deg: Sequence[float] | None
    """Rotation of the sample about the axes of the camera, in degrees."""
    sample_mm: Sequence[float] | None
    """Position of the sample in camera coordinates, in mm."""
    panel_turn_deg: Sequence[float] | None
    """Rotation of the panel about the axes of the sample, in degrees."""
    panel_mm: Sequence[float] | None
    """Centre of the panel in sample coordinates, in mm."""
    light_mm: Sequence[float] | None
    """Position of the light in sample coordinates, in mm."""
    wavelength_nm: float | None
    """Wavelength, in nm."""


class Wedge(TypedDict, total=False):
    """Image shift that turns with the analyser: its length, and its direction at the transmission axis."""

    shift_px: float
    """Length of the shift in pixels."""
    direction_deg: float
    """Direction of the shift relative to the transmission axis in degrees, anticlockwise."""
    sigma_px: float
    """Standard deviation of each component in pixels."""

