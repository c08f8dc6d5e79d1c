# Written by processing/python/generate --update.

"""Operations as functions. Options that are None take the default of the operation."""

from __future__ import annotations

from typing import Any, Literal, Sequence

from . import reports
from ._running import Input, Out, Progress, Result, run


def polarization(
    input: Input = None,
    out: Out = None,
    *,
    model: Literal['auto', 'plain', 'sinusoid', 'prenormalized', 'circle', 'curve'] | None = None,
    align: Literal['auto', 'off'] | None = None,
    oblique: Literal['auto', 'off'] = 'off',
    demosaic: Literal['none', 'bilinear', 'edge-aware'] = 'none',
    offset_deg: float | None = None,
    smooth: str = 'light',
    smooth_maps: bool = False,
    smoothed_exr: bool = False,
    relative_period: Sequence[float] | None = None,
    contrast_period: Sequence[float] | None = None,
    depth_um: float | None = None,
    metal: str | None = None,
    index_above: float | None = None,
    wavelength_nm: float | None = None,
    max_error: float | None = None,
    palette: Literal['cyclic', 'hsv'] = 'cyclic',
    no_scale_bar: bool = False,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.PolarizationReport]:
    """Orientation of gratings from photographs behind a turning analyser, or from a polarization sensor.

    Input: Session folder, frames.json, or a folder holding one (`nacre import` makes one for your photographs).

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    model
        Model: plain, or how the fitted phase becomes the orientation of a grating (default: auto for capture
        sessions, plain for other photographs). plain: Stokes parameters, angle and degree of linear polarization.
        auto: the simplest grating model that explains the data. sinusoid: the phase is the orientation.
        prenormalized: the phase about the mean of all pixels. circle: the phase about the centre of the circle on
        which they lie. curve: the closest point on the curve of the fitted film.
    align
        Registration: auto corrects shifts between photographs if that reduces the error, off never does (default:
        auto for grating models, off for plain).
    oblique
        Correction of oblique incidence: auto applies it if the camera geometry is known and improves the fit; off
        includes the effect in σ.
    demosaic
        Full-size maps of a monochrome polarization sensor: interpolation of the image behind each polarizer (model
        plain). none: one map pixel per 2×2 super-pixel, the fastest and least noisy. bilinear: means of the nearest
        pixels. edge-aware: Newton polynomials of the difference between polarizers, along edges (Li et al. 2019).
    offset_deg
        Offset added to every orientation, in degrees (default: that of the photographs' calibration, or 0).
    smooth
        Smoothing of orientations in pictures: none, light (10 rounds of a bilateral filter), strong (50) or a number
        of rounds.
    smooth_maps
        Also smooth orientation.exr and its σ.
    smoothed_exr
        Also write smoothed.exr: the smoothed orientations at full size.
    relative_period
        Heuristic periods from the brightness, scaled to MIN:MAX µm. Method of the 2018 paper (section 5.4). Only the
        order of the periods is meaningful, and uneven light or reflectance appears as a change of period.
    contrast_period
        Periods from the degree of polarization, known to lie within MIN:MAX µm, for an assumed surface (needs its
        depth). Off by 11 to 18 % for every 10 % of error in depth.
    depth_um
        Assumed peak-to-peak depth of the grating in µm, for contrast_period.
    metal
        Assumed metal, for contrast_period: aluminium (default), silver, gold, chromium (near 560 nm), or its
        refractive index N,K.
    index_above
        Assumed refractive index above the metal, for contrast_period (default: 1).
    wavelength_nm
        Wavelength in nm, for contrast_period (default: that of the photographs).
    max_error
        Largest acceptable error of a typical orientation in degrees, all known terms included. The results are
        written in any case; the exit code is 1 when the estimate is larger or cannot be made.
    palette
        Colour map of angles in pictures: cyclic (even steps, also for colour-blind readers) or hsv.
    no_scale_bar
        Leave the scale bar out of pictures. They have one where the pixel size on the sample is known.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('polarization', input, out, overwrite, progress, {
        'model': model,
        'align': align,
        'oblique': oblique,
        'demosaic': demosaic,
        'offset_deg': offset_deg,
        'smooth': smooth,
        'smooth_maps': smooth_maps,
        'smoothed_exr': smoothed_exr,
        'relative_period': relative_period,
        'contrast_period': contrast_period,
        'depth_um': depth_um,
        'metal': metal,
        'index_above': index_above,
        'wavelength_nm': wavelength_nm,
        'max_error': max_error,
        'palette': palette,
        'no_scale_bar': no_scale_bar,
    })


def hdr(
    input: Input = None,
    out: Out = None,
    *,
    response: str = 'stated',
    align: Literal['auto', 'off'] = 'auto',
    white: float | None = None,
    max_error: float | None = None,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.HdrReport]:
    """One photograph of high dynamic range from several exposures.

    Input: Session folder, frames.json, or a folder of photographs that say their exposure times (Exif).

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    response
        Response of the camera: stated, linear, recover, or the response.json of an earlier recovery. stated is the
        transfer function of frames.json. Without one, the response of 8-bit photographs is recovered, and that of
        others is linear.
    align
        auto corrects shifts between exposures where that reduces the error; off leaves them.
    white
        File value of a saturated pixel, above black; by default as the photographs and frames.json state.
    max_error
        Largest acceptable relative standard deviation of a typical value. The results are written in any case; the
        exit code is 1 when it is larger.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('hdr', input, out, overwrite, progress, {
        'response': response,
        'align': align,
        'white': white,
        'max_error': max_error,
    })


def stack(
    input: Input = None,
    out: Out = None,
    *,
    clip_sigma: float | None = 4.0,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.StackReport]:
    """Mean, median and noise of a series of photographs, without outliers.

    Input: Folder of photographs of one view, all of one size and exposure.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    clip_sigma
        Outliers: values further from the median of their pixel than this many robust standard deviations, or off. The
        standard deviation is computed from the median absolute deviation. It is at least the median over pixels of
        similar brightness in the same row. Series of fewer than four photographs have no outliers.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('stack', input, out, overwrite, progress, {
        'clip_sigma': clip_sigma,
    })


def lut(
    input: Input = None,
    out: Out = None,
    *,
    wavelength_nm: float | Sequence[float] | None = None,
    scale: float | None = None,
    geometry: dict[str, Any] | None = None,
    center: Sequence[float] | None = None,
    size: int = 1024,
    extent: float | None = None,
    warp: int = 1,
    illuminant: str = 'E',
    observer: Literal['1931', '1964'] = '1931',
    exponent: float = 4.0,
    max_error: float = 0.01,
    method: Literal['auto'] | dict[str, Any] = 'auto',
    channel: Literal['r', 'g', 'b', 'luminance'] | None = None,
    transfer: Literal['linear'] | Literal['srgb'] | dict[str, Any] | Literal['recover'] | None = None,
    light: dict[str, Any] | None = None,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.LutReport]:
    """Lookup table of a diffraction pattern under any light, from one photograph in narrow-band light.

    Input: Photograph (EXR, PNG, TIFF), results of `reconstruct hdr`, or a session of exposures, which are merged
    first.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    wavelength_nm
        Wavelength of the photograph in nm, or three for its red, green and blue channel (default: that of
        frames.json).
    scale
        Half vector per pixel, for a distant camera and flash: twice the pixel size on the surface over their
        distance.
    geometry
        Positions of camera and flash (TOML or geometry.json), in place of scale; default: those of frames.json.
        Corrects for cosine, inverse square, near field and G.
    center
        Pixel of the zero order from the left and the top, or auto: the brightest lobe.
    size
        Entries of a row and a column, 16 to 8192.
    extent
        Largest component of the half vector, up to 2 (default: the range measured at nearly all wavelengths).
    warp
        Odd power n of the warp, which gathers entries in the middle: they lie at extent·aⁿ.
    illuminant
        Spectrum of the light that the table is for: a name or a CSV file.
    observer
        Standard observer of the CIE: 1931 (2°) or 1964 (10°).
    exponent
        Power of λm/λ: 4 is exact for shallow gratings to first order, 2 is the paper's. No power is exact for deep
        gratings.
    max_error
        Largest acceptable error at the rim: root mean square over that of the table there. The table is written in
        any case; the exit code is 1 when the error is larger.
    method
        Summation: auto is the cheapest of rays and single that meets the error; fixed steps of wavelength are the
        paper's.
    channel
        Channel of a colour photograph (default: that of the wavelength).
    transfer
        Transfer function of the photograph (required for 8-bit files; default: linear).
    light
        Photograph of the light's mirror image, for an extended light; the table is convolved with it.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('lut', input, out, overwrite, progress, {
        'wavelength_nm': wavelength_nm,
        'scale': scale,
        'geometry': geometry,
        'center': center,
        'size': size,
        'extent': extent,
        'warp': warp,
        'illuminant': illuminant,
        'observer': observer,
        'exponent': exponent,
        'max_error': max_error,
        'method': method,
        'channel': channel,
        'transfer': transfer,
        'light': light,
    })


def bokeh(
    input: Input = None,
    out: Out = None,
    *,
    psf: dict[str, Any],
    channel: Literal['red', 'green', 'blue', 'luminance'] = 'blue',
    transfer: Literal['linear'] | Literal['srgb'] | dict[str, Any] | Literal['recover'] | None = None,
    crop: Sequence[int] | None = None,
    rotate_deg: float = 0.0,
    iterations: dict[str, Any] | None = None,
    noise: dict[str, Any] | None = None,
    accelerate: bool = True,
    calibration: dict[str, Any] | None = None,
    known: dict[str, Any] | None = None,
    scale: Literal['unknown'] | dict[str, Any] = 'unknown',
    lens: dict[str, Any] | None = None,
    wavelength_nm: float = 450.0,
    slice: Sequence[float] | None = None,
    slice_width: int = 15,
    no_scale_bar: bool = False,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.BokehReport]:
    """Height and lines of a grating, from a photograph of an out-of-focus highlight on it.

    Input: Photograph of the highlight (PNG, TIFF, JPEG, EXR), results of `reconstruct hdr`, or a session of
    exposures, which are merged first.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    psf
        Blur of the lens, which is removed: standard deviation of a Gaussian in pixels, or an image of a point.
    channel
        Channel of a colour photograph.
    transfer
        Transfer function of the photograph (default: sRGB for JPEG, else linear).
    crop
        Part of the photograph: left, top, width and height in pixels (default: all of it).
    rotate_deg
        Rotation of the result in degrees, anticlockwise; multiples of 90 are exact.
    iterations
        Number of iterations; auto stops where they find more noise than structure.
    noise
        Noise of the camera: electrons at white and read noise in electrons (default: estimated from the photograph).
    accelerate
        Accelerate iterations by extrapolation; plain Richardson-Lucy needs several times as many.
    calibration
        Calibration of light to height (calibration.json of an earlier result).
    known
        Known grating, from which light is calibrated to height.
    scale
        Size of a pixel on the sample in µm, or line density of the grating.
    lens
        The lens, which gives its cut-off.
    wavelength_nm
        Wavelength of the light in nm.
    slice
        Ends of the slice across the lines: x0, y0, x1, y1 in pixels (default: across the middle).
    slice_width
        Width of the slice in pixels, over which it is averaged.
    no_scale_bar
        Leave the scale bar out of pictures. They have one where the size of a pixel is known.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('bokeh', input, out, overwrite, progress, {
        'psf': psf,
        'channel': channel,
        'transfer': transfer,
        'crop': crop,
        'rotate_deg': rotate_deg,
        'iterations': iterations,
        'noise': noise,
        'accelerate': accelerate,
        'calibration': calibration,
        'known': known,
        'scale': scale,
        'lens': lens,
        'wavelength_nm': wavelength_nm,
        'slice': slice,
        'slice_width': slice_width,
        'no_scale_bar': no_scale_bar,
    })


def foil(
    input: Input = None,
    out: Out = None,
    *,
    geometry: dict[str, Any] | None = None,
    period_um: Sequence[float] | None = None,
    bins: Sequence[int] | None = None,
    depth_um: float | None = None,
    light_height_mm: float | None = None,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.FoilReport]:
    """Distribution of orientations and periods of a foil's random dots, from one photograph under a flash.

    Input: The photograph (EXR, or 16-bit PNG or TIFF in linear light), results of `reconstruct hdr`, or a session of
    exposures, which are merged first.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    geometry
        Positions of camera, foil and light (geometry.json; default: the one beside the photograph).
    period_um
        Shortest and longest period in µm (default: from the picture's corners to the zero order's glare).
    bins
        Bins of orientation and of period (default: as fine as pixels allow).
    depth_um
        Peak-to-peak depth of the sinusoidal gratings in µm: corrects for efficiencies and for second and third
        orders. Without it, gratings count as shallow, and all light as first orders.
    light_height_mm
        Height of the light above the foil in mm, for a geometry without a light: its position follows from the zero
        order.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('foil', input, out, overwrite, progress, {
        'geometry': geometry,
        'period_um': period_um,
        'bins': bins,
        'depth_um': depth_um,
        'light_height_mm': light_height_mm,
    })


def spots(
    input: Input = None,
    out: Out = None,
    *,
    geometry: dict[str, Any] | None = None,
    wavelength_nm: float | None = None,
    wavelength_sigma_nm: float | None = None,
    panel_mm: Sequence[float] | None = None,
    aperture_mm: float | None = None,
    periods_um: Sequence[float] | None = None,
    mirror_deg: float = 0.2,
    palette: Literal['cyclic', 'hsv'] = 'cyclic',
    no_scale_bar: bool = False,
    polarization: str | None = None,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.SpotsReport]:
    """Orientation and absolute period of gratings from fringes on the panel.

    Input: A session of kind spots with fringes, a frames.json or a folder holding one.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    geometry
        Positions of camera, sample and display (geometry.json; default: the distances of frames.json).
    wavelength_nm
        Effective wavelength of light, filter and camera together, in nm (default: that of the geometry or of
        frames.json).
    wavelength_sigma_nm
        Standard deviation of the effective wavelength in nm; it contributes to the σ of all periods.
    panel_mm
        Width and height of the display in mm (default: those of the geometry or of frames.json).
    aperture_mm
        Diameter of the camera's aperture in mm (default: estimated from the photographs).
    periods_um
        Shortest and longest period considered, in µm.
    mirror_deg
        Standard deviation of the mirror direction about that of a plane surface, in degrees: an uneven sample.
    palette
        Colour map of angles in pictures: cyclic (even steps, also for colour-blind readers) or hsv.
    no_scale_bar
        Leave the scale bar out of pictures. They have one where the pixel size on the sample is known.
    polarization
        Results of `reconstruct polarization` of the same sample and camera, which decide between gratings.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('spots', input, out, overwrite, progress, {
        'geometry': geometry,
        'wavelength_nm': wavelength_nm,
        'wavelength_sigma_nm': wavelength_sigma_nm,
        'panel_mm': panel_mm,
        'aperture_mm': aperture_mm,
        'periods_um': periods_um,
        'mirror_deg': mirror_deg,
        'palette': palette,
        'no_scale_bar': no_scale_bar,
        'polarization': polarization,
    })


def flash(
    input: Input = None,
    out: Out = None,
    *,
    geometry: dict[str, Any] | None = None,
    corners_px: Sequence[Sequence[float]] | None = None,
    size_mm: Sequence[float] | None = None,
    camera_mm: float | None = None,
    light_height_mm: float | None = None,
    tiles: Sequence[int] | None = None,
    reference_px: Sequence[float] | None = None,
    unregistered: bool = False,
    wavelength_nm: float | None = None,
    period_um: Sequence[float] | None = None,
    orientation: Literal['half', 'image'] = 'half',
    period: Literal['auto', 'sample', 'pixel'] = 'auto',
    directions: Literal['auto', 'shared', 'free'] = 'free',
    light_sigma_mm: float | None = None,
    trust_lights: bool = False,
    pixel_mm: float | None = None,
    palette: Literal['cyclic', 'hsv'] = 'cyclic',
    no_scale_bar: bool = False,
    max_error: float | None = None,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.FlashReport]:
    """Orientation and absolute period of gratings on a sheet of repeated tiles, from photographs under a flash.

    Input: Session folder or frames.json of flash photographs.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    geometry
        Positions of camera and sheet (geometry.json; default: the one beside the photographs).
    corners_px
        Corners of the sheet in pixels, without a calibrated geometry: top left, top right, bottom right, bottom left.
        auto detects them in the photograph under room light.
    size_mm
        Width and height of the sheet in mm.
    camera_mm
        Height of the camera above the sheet in mm, without a calibrated geometry.
    light_height_mm
        Height of the light above the sheet in mm, in place of that of the photographs; its position follows from the
        highlight.
    tiles
        Number of tiles to the right and down, which fill the sheet (default: one, or those found with reference_px).
    reference_px
        A tile in the photograph by room light: left, top, width and height in pixels. The others are found by
        correlation.
    unregistered
        Leave tiles on their grid, rather than registering each with the others.
    wavelength_nm
        Wavelength in nm (default: that of frames.json or of the geometry).
    period_um
        Range in µm in which all periods are known to lie; distinguishes first orders from second ones.
    orientation
        Orientations: half fits lobes over half vectors, image is the direction to the highlight in the image (2018
        paper).
    period
        One period for all pixels, or one each; auto is that with more evidence.
    directions
        Shared gratings: places with the same grooves are fitted together, so that one photograph can be enough. auto
        decides by evidence. Periods that change gradually over the sheet can look like evidence. shared masks areas
        with grooves of their own.
    light_sigma_mm
        Standard deviation of the light in its plane, in mm (default: that of its highlight).
    trust_lights
        Trust stated positions of lights, even where their highlights contradict.
    pixel_mm
        Size of a map pixel on the sheet in mm (default: that of the photographs).
    palette
        Colour map of angles in pictures: cyclic (even steps, also for colour-blind readers) or hsv.
    no_scale_bar
        Leave the scale bar out of pictures.
    max_error
        Largest acceptable σ of a typical orientation in degrees. The results are written in any case; the exit code
        is 1 when it is larger.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('flash', input, out, overwrite, progress, {
        'geometry': geometry,
        'corners_px': corners_px,
        'size_mm': size_mm,
        'camera_mm': camera_mm,
        'light_height_mm': light_height_mm,
        'tiles': tiles,
        'reference_px': reference_px,
        'unregistered': unregistered,
        'wavelength_nm': wavelength_nm,
        'period_um': period_um,
        'orientation': orientation,
        'period': period,
        'directions': directions,
        'light_sigma_mm': light_sigma_mm,
        'trust_lights': trust_lights,
        'pixel_mm': pixel_mm,
        'palette': palette,
        'no_scale_bar': no_scale_bar,
        'max_error': max_error,
    })


def brdf(
    input: Input = None,
    out: Out = None,
    *,
    pixel_um: float | None = None,
    range_um: float | None = None,
    channel: str | None = None,
    fill_gaps: float | None = None,
    level: bool = False,
    size: int = 512,
    zoom: float = 1.0,
    center: Sequence[float] | None = None,
    settings: dict[str, Any] | None = None,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.BrdfReport]:
    """Picture of the light that a height field diffracts into all directions.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    pixel_um
        Pixel pitch of the height field in µm, unless its file states it.
    range_um
        Height of white above black in µm, unless the file states it.
    channel
        Channel of a file with several: its name, or its number from 1 (default: the first height channel).
    fill_gaps
        Largest fraction of gaps to fill by interpolation, above 0 and at most 0.5; by default none are filled.
    level
        Subtract the best-fitting plane, for tilted samples.
    size
        Pixels per side of the map, 8 to 4096.
    zoom
        Magnification: 4 shows a square of a quarter of the sines, for single orders.
    center
        Centre of the map as sines, sin θ (cos φ, sin φ).
    settings
        Light, material, accuracy.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('brdf', input, out, overwrite, progress, {
        'pixel_um': pixel_um,
        'range_um': range_um,
        'channel': channel,
        'fill_gaps': fill_gaps,
        'level': level,
        'size': size,
        'zoom': zoom,
        'center': center,
        'settings': settings,
    })


def map(
    input: Input = None,
    out: Out = None,
    *,
    rotate_deg: float | None = None,
    resample: float | None = None,
    tile: Sequence[int] | None = None,
    size: Sequence[int] | None = None,
    layout: Literal['repeat', 'mirror', 'brick'] = 'repeat',
    orientation_offset_deg: float | None = None,
    period: dict[str, Any] | None = None,
    scale: float | None = None,
    offset_um: float | None = None,
    clamp_um: Sequence[float] | None = None,
    palette: Literal['cyclic', 'hsv'] | None = None,
    no_scale_bar: bool | None = None,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.MapReport]:
    """Edited maps of orientation and period.

    Input: Folder with orientation.exr, period.exr or both, or one of the files.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    rotate_deg
        Rotation of image and orientations in degrees, anticlockwise; multiples of 90 are exact.
    resample
        Scale factor of the number of pixels along each axis.
    tile
        Number of copies along a row and a column.
    size
        Width and height in pixels; crops, or fills with further copies.
    layout
        Arrangement of copies.
    orientation_offset_deg
        Rotation of orientations alone in degrees, anticlockwise.
    period
        Periods as a function of orientation: from the first at 0° to the second at 180° in µm, or rows of
        orientation_deg,period_um. Replaces existing periods.
    scale
        Scale factor of periods.
    offset_um
        Offset of periods in µm.
    clamp_um
        Minimum and maximum period in µm; other values are clamped.
    palette
        Colour map of angles in the picture: cyclic (even steps, also for colour-blind readers) or hsv.
    no_scale_bar
        Leave the scale bar out of the picture. It has one where the maps have `pixel_um`.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('map', input, out, overwrite, progress, {
        'rotate_deg': rotate_deg,
        'resample': resample,
        'tile': tile,
        'size': size,
        'layout': layout,
        'orientation_offset_deg': orientation_offset_deg,
        'period': period,
        'scale': scale,
        'offset_um': offset_um,
        'clamp_um': clamp_um,
        'palette': palette,
        'no_scale_bar': no_scale_bar,
    })


def calibrate(
    input: Input = None,
    out: Out = None,
    *,
    board: Sequence[int] | None = None,
    square_mm: float = 25.0,
    sample_corners_px: Sequence[Sequence[float]] | None = None,
    sample_mm: Sequence[float] | None = None,
    geometry: dict[str, Any] | None = None,
    highlights: Sequence[dict[str, Any]] | None = None,
    light_height_mm: Sequence[float] | None = None,
    wavelength_nm: float | None = None,
    wavelength_sigma_nm: float | None = None,
    lamp: str | None = None,
    filter: Sequence[Sequence[float]] | None = None,
    response: Sequence[Sequence[float]] | None = None,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.CalibrateReport]:
    """Camera, sample and light, from photographs of a board and of the light in a mirror.

    Input: A folder of photographs of a board, or of the light in a mirror; none where an earlier geometry suffices.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    board
        Inner corners of the board along a row and a column.
    square_mm
        Size of a square in mm.
    sample_corners_px
        Corners of the sample (upper left, upper right, lower right, lower left) in pixels; default: it lies where the
        first board does.
    sample_mm
        Width and height of the sample in mm, which go with its corners.
    geometry
        An earlier geometry.json: values that are not measured anew are kept, and no photographs of a board are
        needed.
    highlights
        Mirror images of the light.
    light_height_mm
        Height of the light above the sample and its standard deviation, in mm, if measured otherwise.
    wavelength_nm
        Wavelength in nm, if known.
    wavelength_sigma_nm
        Standard deviation of the wavelength in nm (default: 0.5).
    lamp
        Spectrum of the lamp by name, with filter and response in place of the wavelength: E, A, D65, FL1 to FL12,
        LED-B1, LED-B3.
    filter
        Transmission of the filter: pairs of wavelength in nm and transmittance.
    response
        Spectral response of the camera channel: pairs of wavelength in nm and response.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('calibrate', input, out, overwrite, progress, {
        'board': board,
        'square_mm': square_mm,
        'sample_corners_px': sample_corners_px,
        'sample_mm': sample_mm,
        'geometry': geometry,
        'highlights': highlights,
        'light_height_mm': light_height_mm,
        'wavelength_nm': wavelength_nm,
        'wavelength_sigma_nm': wavelength_sigma_nm,
        'lamp': lamp,
        'filter': filter,
        'response': response,
    })


def render(
    input: Input = None,
    out: Out = None,
    *,
    samples: int = 256,
    max_error: float = 0.01,
    wavelengths: int | None = None,
    check: bool = False,
    spectral_nm: float | None = None,
    method: Literal['auto', 'samples', 'two-pass'] = 'auto',
    rank: int | None = None,
    scene: str | None = None,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.RenderReport]:
    """Picture of a scene: measured and invented surfaces under any light.

    Input: A folder with one scene (TOML) and the files that it names.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    samples
        Largest number of samples per pixel, averaged over lit pixels. Half of the samples are distributed by noise.
    max_error
        Target error: root mean square of the pixels' standard errors, relative to the mean luminance.
    wavelengths
        Fixed number of wavelengths, evenly spaced in 1/λ; default: as many as each surface point needs.
    check
        Also measure the truncation error of the sums over orders and wavelengths.
    spectral_nm
        Spacing of spectral bands in nm (1 to 100) for a spectrum per pixel, stored as EXR channels S0.550,000000nm
        and so on.
    method
        Method for lookup tables under environments: auto is the cheapest that meets the target error.
    rank
        Largest number of terms per channel and part of a table in two passes (1 to 96); default: as many as the error
        requires.
    scene
        Text of a scene (TOML) that replaces the scene of the folder, beside the same files.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('render', input, out, overwrite, progress, {
        'samples': samples,
        'max_error': max_error,
        'wavelengths': wavelengths,
        'check': check,
        'spectral_nm': spectral_nm,
        'method': method,
        'rank': rank,
        'scene': scene,
    })


def factor(
    input: Input = None,
    out: Out = None,
    *,
    rank: int | None = None,
    max_error: float = 0.05,
    kind: Literal['singular', 'nonnegative', 'line'] = 'singular',
    parts: int = 1,
    directions_deg: Sequence[float] | None = None,
    min_angle_deg: float = 60.0,
    environment: str | None = None,
    layer: str | None = None,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.FactorReport]:
    """Separable terms of a lookup table, for environment lighting.

    Input: The table: lut.exr of `nacre reconstruct lut`, or a folder that holds it.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    rank
        Number of terms per channel and part (default: as many as the error requires).
    max_error
        Largest error of the table: root mean square of the residual over that of the table. No effect if the rank is
        given.
    kind
        Factorisation: singular (singular vectors, least error), nonnegative (non-negative terms) or line (one curve
        along the first direction, for gratings and discs).
    parts
        Number of parts of the table, one along each main direction.
    directions_deg
        The two directions in degrees, anticlockwise from the right, instead of detected ones; the second lies along
        the meridians.
    min_angle_deg
        Minimum angle between the two directions in degrees.
    environment
        Lat-long environment (EXR or HDR) in which the picture error is measured.
    layer
        Layer, view or part of an OpenEXR environment that contains several pictures.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('factor', input, out, overwrite, progress, {
        'rank': rank,
        'max_error': max_error,
        'kind': kind,
        'parts': parts,
        'directions_deg': directions_deg,
        'min_angle_deg': min_angle_deg,
        'environment': environment,
        'layer': layer,
    })


def synthesize(
    input: Input = None,
    out: Out = None,
    *,
    size: Sequence[int],
    pixel_um: float,
    dot: dict[str, Any],
    seed: int = 1,
    palette: Literal['cyclic', 'hsv'] = 'cyclic',
    no_scale_bar: bool = False,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.SynthesizeReport]:
    """Maps of new foil, drawn from a measured distribution of random dots.

    Input: Results of `nacre reconstruct foil`, or their histogram.exr.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    size
        Width and height of the maps in pixels.
    pixel_um
        Size of a pixel in µm.
    dot
        Shape of the dots.
    seed
        Seed of the random numbers; the same seed gives the same maps.
    palette
        Colour map of angles in the picture: cyclic (even steps, also for colour-blind readers) or hsv.
    no_scale_bar
        Leave the scale bar out of the picture.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('synthesize', input, out, overwrite, progress, {
        'size': size,
        'pixel_um': pixel_um,
        'dot': dot,
        'seed': seed,
        'palette': palette,
        'no_scale_bar': no_scale_bar,
    })


def inspect(
    input: Input = None,
    out: Out = None,
    *,
    reference: str,
    limits: str | None = None,
    train: bool = False,
    false_alarms: float = 0.1,
    min_area_px: int = 4,
    max_turn_deg: float = 10.0,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.InspectionReport]:
    """Defects of a sheet, by comparison with a reference.

    Input: The sample: a result folder of `nacre reconstruct`, or a folder of such folders.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    reference
        Reference: the results of a good sheet, or a design with orientations (result folder or EXR map).
    limits
        Limits of good sheets, a TOML file of --train (default: no defect of any class).
    train
        Train limits: the samples are good; writes limits.toml.
    false_alarms
        Accepted false alarms per sheet, 0.000001 to 1; it sets the threshold of differences.
    min_area_px
        Smallest number of connected pixels of a defect, 1 to 10000.
    max_turn_deg
        Largest turn of the sample from the reference in degrees, 0 to 180.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('inspect', input, out, overwrite, progress, {
        'reference': reference,
        'limits': limits,
        'train': train,
        'false_alarms': false_alarms,
        'min_area_px': min_area_px,
        'max_turn_deg': max_turn_deg,
    })


def camera(
    input: Input = None,
    out: Out = None,
    *,
    darks: str | None = None,
    channel: int | None = None,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.CameraReport]:
    """Noise of a camera, from photographs of even light and of darkness.

    Input: Folder of photographs of even light: each exposure twice or more.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    darks
        Folder of photographs of darkness, each exposure twice or more (default: the `dark` of each frame).
    channel
        Channel of colour photographs: 0 red, 1 green, 2 blue.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('camera', input, out, overwrite, progress, {
        'darks': darks,
        'channel': channel,
    })


def flat(
    input: Input = None,
    out: Out = None,
    *,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.FlatReport]:
    """Flat field of light and lens, from photographs of a uniform surface.

    Input: Session or frames.json of a uniform surface, photographed several times under one light.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('flat', input, out, overwrite, progress, {
    })


def analyser(
    input: Input = None,
    out: Out = None,
    *,
    axis_deg: float | None = None,
    axis_sigma_deg: float = 0.0,
    flipped: str | None = None,
    clockwise: bool = False,
    region: Sequence[int] | None = None,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.AnalyserReport]:
    """Zero and extinction of the analyser, from photographs of a reference polarizer.

    Input: Session over the full turn of the analyser, with a linear polarizer on the sample table.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    axis_deg
        Axis of the reference polarizer in degrees, anticlockwise from the right of the image; with flipped, within
        20°.
    axis_sigma_deg
        Standard deviation of the axis in degrees, without flipped.
    flipped
        Second series, with the polarizer turned over about a vertical line of the image.
    clockwise
        The analyser turns clockwise, as seen by the camera (without flipped, which determines it).
    region
        Region of even light: left, top, width, height in pixels (default: the middle half of each side).
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('analyser', input, out, overwrite, progress, {
        'axis_deg': axis_deg,
        'axis_sigma_deg': axis_sigma_deg,
        'flipped': flipped,
        'clockwise': clockwise,
        'region': region,
    })


def retarder(
    input: Input = None,
    out: Out = None,
    *,
    bare: str | None = None,
    panel_deg: float | None = None,
    panel_sigma_deg: float = 0.0,
    azimuth_deg: float | None = None,
    region: Sequence[int] | None = None,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.RetarderReport]:
    """Azimuth and retardance of the panel's film, from the polarization of its light.

    Input: Session over the turn of the analyser, with a mirror on the sample table and the panel lit.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    bare
        Series of the panel without its retarder.
    panel_deg
        Direction of the panel's linear polarization in degrees, if there is no series without retarder.
    panel_sigma_deg
        Standard deviation of that direction in degrees.
    azimuth_deg
        Direction of the retarder's axis in degrees, within 40° (default: 45° from the panel's polarization). The
        perpendicular axis gives the other handedness, which an analyser cannot distinguish.
    region
        Region of even light: left, top, width, height in pixels (default: the middle half of each side).
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('retarder', input, out, overwrite, progress, {
        'bare': bare,
        'panel_deg': panel_deg,
        'panel_sigma_deg': panel_sigma_deg,
        'azimuth_deg': azimuth_deg,
        'region': region,
    })


def orientation(
    input: Input = None,
    out: Out = None,
    *,
    known_deg: float | None = None,
    known_sigma_deg: float = 0.0,
    center_px: Sequence[float] | None = None,
    known_map: str | None = None,
    region: Sequence[int] | None = None,
    overwrite: bool = False,
    progress: Progress = None,
) -> Result[reports.OrientationReport]:
    """Offset of orientations, from a map of a sample of known orientation.

    Input: Result folder of `nacre reconstruct polarization` for a sample of known orientation.

    Parameters
    ----------
    input
        Folder or file; for photographs also `nacre.Photographs`.
    out
        New folder for the result. Without it, the result is in a temporary folder that lives as long as the returned object.
    known_deg
        Direction of the grating vector in degrees, perpendicular to the lines.
    known_sigma_deg
        Standard deviation of that direction in degrees.
    center_px
        Centre of a disc with circular tracks in pixels, from the left and from the top, instead of known_deg.
    known_map
        Map of the sample's true orientations (EXR of the same size, channel orientation in rad), instead of
        known_deg.
    region
        Region of the known sample: left, top, width, height in pixels (default: the middle half of each side, or
        everything for a disc or a map).
    overwrite
        Replace files of the same names in an existing folder.
    progress
        Called as `progress(stage, done, steps)`.
    """
    return run('orientation', input, out, overwrite, progress, {
        'known_deg': known_deg,
        'known_sigma_deg': known_sigma_deg,
        'center_px': center_px,
        'known_map': known_map,
        'region': region,
    })

__all__ = [
    'analyser',
    'bokeh',
    'brdf',
    'calibrate',
    'camera',
    'factor',
    'flash',
    'flat',
    'foil',
    'hdr',
    'inspect',
    'lut',
    'map',
    'orientation',
    'polarization',
    'render',
    'retarder',
    'spots',
    'stack',
    'synthesize',
]
