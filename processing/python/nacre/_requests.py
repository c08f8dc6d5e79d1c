# Written by processing/python/generate --update.

"""Requests of the service, as methods."""

from __future__ import annotations

from typing import Any

from urllib.parse import quote, urlencode


class Requests:
    """One method per request; paths and keys as in `docs/reference/rest.md`.

    Methods return decoded JSON, or bytes of other types.
    """

    def _send(self, method: str, path: str, body: Any = None, headers: dict[str, str] | None = None) -> Any:
        raise NotImplementedError

    def about(self) -> Any:
        """Reads version and state of the program."""
        path = '/api/v1/about'
        return self._send('GET', path)

    def calibrations(self, *, kind: Any = None, applies: Any = None, max_age_days: Any = None) -> Any:
        """Lists calibrations, at most 1000, the newest photographs first."""
        path = '/api/v1/calibrations'
        query = {k: v for k, v in {'kind': kind, 'applies': applies, 'max_age_days': max_age_days}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('GET', path)

    def keep_calibration(self, body: Any = None) -> Any:
        """Keeps a finished result as a calibration."""
        path = '/api/v1/calibrations'
        return self._send('POST', path, body)

    def calibration(self, id: str) -> Any:
        """Reads a calibration with its report."""
        path = f"/api/v1/calibrations/{quote(str(id), safe='/')}"
        return self._send('GET', path)

    def delete_calibration(self, id: str) -> Any:
        """Deletes a calibration: it goes to the trash. Sessions that used it keep their copy."""
        path = f"/api/v1/calibrations/{quote(str(id), safe='/')}"
        return self._send('DELETE', path)

    def calibration_deletion(self, id: str) -> Any:
        """Summarises the deletion of a calibration. Its token is not required for the deletion."""
        path = f"/api/v1/calibrations/{quote(str(id), safe='/')}/deletion"
        return self._send('GET', path)

    def calibration_files(self, id: str) -> Any:
        """Lists the files of a calibration."""
        path = f"/api/v1/calibrations/{quote(str(id), safe='/')}/files"
        return self._send('GET', path)

    def calibration_file(self, id: str, file: str) -> Any:
        """Downloads a file of a calibration."""
        path = f"/api/v1/calibrations/{quote(str(id), safe='/')}/files/{quote(str(file), safe='/')}"
        return self._send('GET', path)

    def list_charts(self) -> Any:
        """Lists all charts, the last folder by name first."""
        path = '/api/v1/charts'
        return self._send('GET', path)

    def delete_charts(self, folder: str, *, token: Any = None) -> Any:
        """Deletes a folder of charts, with its measurements."""
        path = f"/api/v1/charts/{quote(str(folder), safe='/')}"
        query = {k: v for k, v in {'token': token}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('DELETE', path)

    def charts_deletion(self, folder: str) -> Any:
        """Summarises the deletion of a folder of charts, and gives the token that confirms it."""
        path = f"/api/v1/charts/{quote(str(folder), safe='/')}/deletion"
        return self._send('GET', path)

    def chart_file(self, folder: str, chart: str, file: str) -> Any:
        """Downloads a file of a chart: SVG, PNG, CSV, JSON or the raw measurements."""
        path = f"/api/v1/charts/{quote(str(folder), safe='/')}/{quote(str(chart), safe='/')}/{quote(str(file), safe='/')}"
        return self._send('GET', path)

    def devices(self) -> Any:
        """Reads the state of the bench."""
        path = '/api/v1/devices'
        return self._send('GET', path)

    def meter_camera(self, body: Any = None) -> Any:
        """Sets the preview's exposure by metering the present light. The analyser stays where it is."""
        path = '/api/v1/devices/camera/meter'
        return self._send('POST', path, body)

    def preview(self) -> Any:
        """Histogram, saturation and mean of the newest frame."""
        path = '/api/v1/devices/camera/preview'
        return self._send('GET', path)

    def preview_picture(self, *, width: Any = None, stretch: Any = None) -> Any:
        """The newest frame as a grey picture with a display's gamma."""
        path = '/api/v1/devices/camera/preview.png'
        query = {k: v for k, v in {'width': width, 'stretch': stretch}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('GET', path)

    def set_camera(self, body: Any = None) -> Any:
        """Sets exposure and gain of the preview."""
        path = '/api/v1/devices/camera/set'
        return self._send('POST', path, body)

    def measure_panel(self, body: Any = None) -> Any:
        """Measures the panel with the camera: uniform levels from black to white and back, and changes between the two."""
        path = '/api/v1/devices/display/measure'
        return self._send('POST', path, body)

    def panel_measurement(self) -> Any:
        """Reads the newest measurement of the panel."""
        path = '/api/v1/devices/display/measurement'
        return self._send('GET', path)

    def show_pattern(self, body: Any = None) -> Any:
        """Shows a pattern until another one is shown or the light is switched off."""
        path = '/api/v1/devices/display/show'
        return self._send('POST', path, body)

    def switch_flash(self, body: Any = None) -> Any:
        """Switches the flash."""
        path = '/api/v1/devices/flash/switch'
        return self._send('POST', path, body)

    def home_stage(self, body: Any = None) -> Any:
        """Homes the stage: finds its mechanical zero."""
        path = '/api/v1/devices/stage/home'
        return self._send('POST', path, body)

    def move_stage(self, body: Any = None) -> Any:
        """Turns the analyser to an angle, approaching it from below."""
        path = '/api/v1/devices/stage/move'
        return self._send('POST', path, body)

    def display(self) -> Any:
        """Reads the state of the pattern page."""
        path = '/api/v1/display'
        return self._send('GET', path)

    def acknowledge(self, body: Any = None) -> Any:
        """Acknowledges that a pattern has been visible for two frames of the page."""
        path = '/api/v1/display/acknowledge'
        return self._send('POST', path, body)

    def display_beat(self, body: Any = None) -> Any:
        """Heartbeat of the page."""
        path = '/api/v1/display/beat'
        return self._send('POST', path, body)

    def display_link(self, *, page: Any = None) -> Any:
        """Binds a page, and sends its patterns as server-sent events `pattern`."""
        path = '/api/v1/display/link'
        query = {k: v for k, v in {'page': page}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('GET', path)

    def show_on_display(self, body: Any = None) -> Any:
        """Shows a pattern on the page; answers once the page has acknowledged it."""
        path = '/api/v1/display/pattern'
        return self._send('POST', path, body)

    def operations(self) -> Any:
        """Lists all operations, with the JSON Schemas of their options and reports."""
        path = '/api/v1/operations'
        return self._send('GET', path)

    def check_plan(self, body: Any = None) -> Any:
        """Checks a plan against the limits of the bench."""
        path = '/api/v1/plans/check'
        return self._send('POST', path, body)

    def estimate_plan(self, body: Any = None) -> Any:
        """Estimates the time and disk space of a session."""
        path = '/api/v1/plans/estimate'
        return self._send('POST', path, body)

    def plan_schema(self) -> Any:
        """The JSON Schema of a plan."""
        path = '/api/v1/plans/schema'
        return self._send('GET', path)

    def queue(self) -> Any:
        """Lists the reconstructions that run or wait, in the order in which they run."""
        path = '/api/v1/queue'
        return self._send('GET', path)

    def move_to_front(self, id: str) -> Any:
        """Moves a waiting reconstruction to the front of the queue."""
        path = f"/api/v1/queue/{quote(str(id), safe='/')}/first"
        return self._send('POST', path)

    def reconstructions(self, *, limit: Any = None, cursor: Any = None) -> Any:
        """Lists reconstructions, newest first."""
        path = '/api/v1/reconstructions'
        query = {k: v for k, v in {'limit': limit, 'cursor': cursor}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('GET', path)

    def reconstruct(self, body: Any = None) -> Any:
        """Queues a reconstruction."""
        path = '/api/v1/reconstructions'
        return self._send('POST', path, body)

    def estimate_reconstruction(self, body: Any = None) -> Any:
        """Estimates time, memory and disk space of a reconstruction."""
        path = '/api/v1/reconstructions/estimate'
        return self._send('POST', path, body)

    def reconstruction(self, id: str) -> Any:
        """Reads a reconstruction, or a session's own results by the session's id."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}"
        return self._send('GET', path)

    def delete_reconstruction(self, id: str, *, token: Any = None) -> Any:
        """Deletes a reconstruction that has ended, with all its files: they go to the trash. Results of a session are
        deleted with the session."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}"
        query = {k: v for k, v in {'token': token}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('DELETE', path)

    def name_reconstruction(self, id: str, body: Any = None) -> Any:
        """Names a reconstruction or rendering. Results of a session have the session's name."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}"
        return self._send('PATCH', path, body)

    def cancel_reconstruction(self, id: str) -> Any:
        """Cancels a reconstruction that has not ended."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/cancel"
        return self._send('POST', path)

    def reconstruction_deletion(self, id: str) -> Any:
        """Summarises the deletion of a reconstruction, and gives the token that confirms it. Its upload is deleted with
        the last reconstruction that uses it."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/deletion"
        return self._send('GET', path)

    def reconstruction_events(self, id: str) -> Any:
        """Streams the states of a reconstruction as server-sent events `state`."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/events"
        return self._send('GET', path)

    def result_files(self, id: str) -> Any:
        """Lists the files of a reconstruction."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/files"
        return self._send('GET', path)

    def result_file(self, id: str, file: str) -> Any:
        """Downloads a file of a reconstruction."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/files/{quote(str(file), safe='/')}"
        return self._send('GET', path)

    def finish_reconstruction(self, id: str) -> Any:
        """Ends the passes of a rendering under way, and keeps its picture so far as the result."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/finish"
        return self._send('POST', path)

    def reconstruction_log(self, id: str) -> Any:
        """Reads the log of a reconstruction, one event per line."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/log"
        return self._send('GET', path)

    def maps(self, id: str) -> Any:
        """The maps of a result: names, sizes, units, and the maps of their standard deviations."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/maps"
        return self._send('GET', path)

    def map(self, id: str, file: str, *, width: Any = None, x: Any = None, y: Any = None, w: Any = None, h: Any = None) -> Any:
        """A map: `NAME.png` for a picture (of a region), `NAME.exr`, `NAME.csv` or `NAME.npy` for its numbers. `maps`
        lists the names, such as orientation, sigma and period."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/maps/{quote(str(file), safe='/')}"
        query = {k: v for k, v in {'width': width, 'x': x, 'y': y, 'w': w, 'h': h}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('GET', path)

    def picture(self, id: str, *, stops: Any = None) -> Any:
        """Picture of a rendering: intermediate pictures about every second, and render.png once it is complete."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/picture.png"
        query = {k: v for k, v in {'stops': stops}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('GET', path)

    def pixel(self, id: str, *, x: Any = None, y: Any = None) -> Any:
        """Reads one pixel: its measured points, the fit, and the values of the maps."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/pixel"
        query = {k: v for k, v in {'x': x, 'y': y}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('GET', path)

    def map_profile(self, id: str, map: str, *, x0: Any = None, y0: Any = None, x1: Any = None, y1: Any = None) -> Any:
        """Values of a map along a line, with their standard deviations."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/profile/{quote(str(map), safe='/')}"
        query = {k: v for k, v in {'x0': x0, 'y0': y0, 'x1': x1, 'y1': y1}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('GET', path)

    def retry_reconstruction(self, id: str) -> Any:
        """Repeats a reconstruction that did not succeed."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/retry"
        return self._send('POST', path)

    def map_statistics(self, id: str, map: str, *, x: Any = None, y: Any = None, w: Any = None, h: Any = None, polygon: Any = None, bins: Any = None) -> Any:
        """Statistics and histogram of a region of a map, or of the whole map."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/statistics/{quote(str(map), safe='/')}"
        query = {k: v for k, v in {'x': x, 'y': y, 'w': w, 'h': h, 'polygon': polygon, 'bins': bins}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('GET', path)

    def map_tile(self, id: str, map: str, level: str, column: str, row: str) -> Any:
        """A tile of a map: 32-bit floats (little-endian) row by row, NaN where masked. Tiles have 256 × 256 pixels, and
        fewer at the right and lower edge. A pixel of level L is the mean of the valid pixels among 2^L × 2^L pixels
        of the map. Orientations are averaged as axial data, modulo 180°."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/tiles/{quote(str(map), safe='/')}/{quote(str(level), safe='/')}/{quote(str(column), safe='/')}/{quote(str(row), safe='/')}"
        return self._send('GET', path)

    def view(self, id: str, *, depth_um: Any = None, period_um: Any = None, profile: Any = None, reflectance: Any = None, spectrum: Any = None, light_sigma_mm: Any = None, side_mm: Any = None, state: Any = None) -> Any:
        """A result as uniforms and textures of the viewer's shaders."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/view"
        query = {k: v for k, v in {'depth_um': depth_um, 'period_um': period_um, 'profile': profile, 'reflectance': reflectance, 'spectrum': spectrum, 'light_sigma_mm': light_sigma_mm, 'side_mm': side_mm, 'state': state}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('GET', path)

    def view_file(self, id: str, *, depth_um: Any = None, period_um: Any = None, profile: Any = None, reflectance: Any = None, spectrum: Any = None, light_sigma_mm: Any = None, side_mm: Any = None, state: Any = None) -> Any:
        """The view and the viewer as one HTML file that opens from disk."""
        path = f"/api/v1/reconstructions/{quote(str(id), safe='/')}/view.html"
        query = {k: v for k, v in {'depth_um': depth_um, 'period_um': period_um, 'profile': profile, 'reflectance': reflectance, 'spectrum': spectrum, 'light_sigma_mm': light_sigma_mm, 'side_mm': side_mm, 'state': state}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('GET', path)

    def samples(self) -> Any:
        """Lists the simulated samples."""
        path = '/api/v1/samples'
        return self._send('GET', path)

    def sample_photographs(self, kind: str) -> Any:
        """Photographs of a simulated sample at analyser angles of 0°, 45°, 90° and 135°, in a row."""
        path = f"/api/v1/samples/{quote(str(kind), safe='/')}/photographs.png"
        return self._send('GET', path)

    def sample_picture(self, kind: str, *, width: Any = None) -> Any:
        """Picture of a simulated sample: its orientations in the colours of maps."""
        path = f"/api/v1/samples/{quote(str(kind), safe='/')}/picture.png"
        query = {k: v for k, v in {'width': width}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('GET', path)

    def try_sample(self, kind: str, body: Any = None) -> Any:
        """Starts a session with results of a simulated sample. It runs beside the bench and moves no device."""
        path = f"/api/v1/samples/{quote(str(kind), safe='/')}/sessions"
        return self._send('POST', path, body)

    def scene_schema(self) -> Any:
        """JSON Schema of a scene."""
        path = '/api/v1/scenes/schema'
        return self._send('GET', path)

    def sessions(self, *, text: Any = None, kind: Any = None, state: Any = None, limit: Any = None, cursor: Any = None) -> Any:
        """Lists sessions, newest first."""
        path = '/api/v1/sessions'
        query = {k: v for k, v in {'text': text, 'kind': kind, 'state': state, 'limit': limit, 'cursor': cursor}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('GET', path)

    def begin_session(self, body: Any = None) -> Any:
        """Starts a session."""
        path = '/api/v1/sessions'
        return self._send('POST', path, body)

    def session(self, id: str) -> Any:
        """Reads a session."""
        path = f"/api/v1/sessions/{quote(str(id), safe='/')}"
        return self._send('GET', path)

    def delete_session(self, id: str, *, token: Any = None) -> Any:
        """Deletes a session with all its files: it goes to the trash."""
        path = f"/api/v1/sessions/{quote(str(id), safe='/')}"
        query = {k: v for k, v in {'token': token}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('DELETE', path)

    def name_session(self, id: str, body: Any = None) -> Any:
        """Names a session."""
        path = f"/api/v1/sessions/{quote(str(id), safe='/')}"
        return self._send('PATCH', path, body)

    def abort_session(self, id: str) -> Any:
        """Aborts at once."""
        path = f"/api/v1/sessions/{quote(str(id), safe='/')}/abort"
        return self._send('POST', path)

    def session_deletion(self, id: str) -> Any:
        """Summarises the deletion of a session, and gives the token that confirms it."""
        path = f"/api/v1/sessions/{quote(str(id), safe='/')}/deletion"
        return self._send('GET', path)

    def session_events(self, id: str) -> Any:
        """Streams the events of a session as server-sent events."""
        path = f"/api/v1/sessions/{quote(str(id), safe='/')}/events"
        return self._send('GET', path)

    def session_files(self, id: str) -> Any:
        """Lists the files of a session."""
        path = f"/api/v1/sessions/{quote(str(id), safe='/')}/files"
        return self._send('GET', path)

    def session_file(self, id: str, path: str) -> Any:
        """Downloads a file of a session."""
        path = f"/api/v1/sessions/{quote(str(id), safe='/')}/files/{quote(str(path), safe='/')}"
        return self._send('GET', path)

    def session_frames(self, id: str) -> Any:
        """Lists the frames, with the evidence that each shows the commanded state."""
        path = f"/api/v1/sessions/{quote(str(id), safe='/')}/frames"
        return self._send('GET', path)

    def session_frame(self, id: str, name: str, *, width: Any = None) -> Any:
        """A frame: the stored 16-bit PNG, or with `width` a smaller picture with a display's gamma."""
        path = f"/api/v1/sessions/{quote(str(id), safe='/')}/frames/{quote(str(name), safe='/')}"
        query = {k: v for k, v in {'width': width}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('GET', path)

    def live_map(self, id: str, *, map: Any = None, width: Any = None) -> Any:
        """Picture of the map computed from the frames so far."""
        path = f"/api/v1/sessions/{quote(str(id), safe='/')}/live.png"
        query = {k: v for k, v in {'map': map, 'width': width}.items() if v is not None}
        path += '?' + urlencode(query, doseq=True) if query else ''
        return self._send('GET', path)

    def pause_session(self, id: str) -> Any:
        """Pauses after the frames in progress, with the light off."""
        path = f"/api/v1/sessions/{quote(str(id), safe='/')}/pause"
        return self._send('POST', path)

    def resume_session(self, id: str) -> Any:
        """Continues a paused session, or takes the missing frames of an ended one. A complete session stays unchanged."""
        path = f"/api/v1/sessions/{quote(str(id), safe='/')}/resume"
        return self._send('POST', path)

    def stop_session(self, id: str) -> Any:
        """Stops after the frames in progress; missing frames can be taken later."""
        path = f"/api/v1/sessions/{quote(str(id), safe='/')}/stop"
        return self._send('POST', path)

    def settings(self) -> Any:
        """Reads the configuration file, and its differences from the configuration in use."""
        path = '/api/v1/settings'
        return self._send('GET', path)

    def save_settings(self, body: Any = None) -> Any:
        """Saves the configuration, with a copy of the file before. Needs the version of the file in `If-Match`."""
        path = '/api/v1/settings'
        return self._send('PUT', path, body)

    def check_settings(self, body: Any = None) -> Any:
        """Checks a configuration without saving it."""
        path = '/api/v1/settings/check'
        return self._send('POST', path, body)

    def settings_schema(self) -> Any:
        """Reads the JSON Schema of the configuration."""
        path = '/api/v1/settings/schema'
        return self._send('GET', path)

    def stop(self) -> Any:
        """Aborts everything and switches all light off."""
        path = '/api/v1/stop'
        return self._send('POST', path)

    def trash(self) -> Any:
        """Lists the trash."""
        path = '/api/v1/trash'
        return self._send('GET', path)

    def empty_trash(self) -> Any:
        """Empties the trash."""
        path = '/api/v1/trash'
        return self._send('DELETE', path)

    def delete_for_good(self, id: str) -> Any:
        """Deletes an entry of the trash for good."""
        path = f"/api/v1/trash/{quote(str(id), safe='/')}"
        return self._send('DELETE', path)

    def restore(self, id: str) -> Any:
        """Restores an entry under its former id."""
        path = f"/api/v1/trash/{quote(str(id), safe='/')}/restore"
        return self._send('POST', path)

    def uploads(self) -> Any:
        """Lists uploads, newest first, at most 1000."""
        path = '/api/v1/uploads'
        return self._send('GET', path)

    def upload(self, body: Any = None) -> Any:
        """Uploads photographs; `POST /api/v1/reconstructions` then computes maps from them."""
        path = '/api/v1/uploads'
        return self._send('POST', path, body)

    def angles_in_names(self, body: Any = None) -> Any:
        """Reads analyser angles from names of photographs, as an upload without `frames` does."""
        path = '/api/v1/uploads/angles'
        return self._send('POST', path, body)

    def delete_upload(self, id: str) -> Any:
        """Deletes an upload that no reconstruction uses: it goes to the trash."""
        path = f"/api/v1/uploads/{quote(str(id), safe='/')}"
        return self._send('DELETE', path)

    def name_upload(self, id: str, body: Any = None) -> Any:
        """Names an upload."""
        path = f"/api/v1/uploads/{quote(str(id), safe='/')}"
        return self._send('PATCH', path, body)

    def upload_deletion(self, id: str) -> Any:
        """Summarises the deletion of an upload. Its token is not required for the deletion."""
        path = f"/api/v1/uploads/{quote(str(id), safe='/')}/deletion"
        return self._send('GET', path)

    def scene(self, id: str) -> Any:
        """Reads the scene of an upload."""
        path = f"/api/v1/uploads/{quote(str(id), safe='/')}/scene"
        return self._send('GET', path)

    def check_scene(self, id: str, body: Any = None) -> Any:
        """Checks an edited scene with the files of an upload, and converts between TOML and JSON."""
        path = f"/api/v1/uploads/{quote(str(id), safe='/')}/scene"
        return self._send('POST', path, body)

    def draft_scene(self, id: str, body: Any = None) -> Any:
        """Renders a draft of an edited scene: a small noisy picture, within seconds. It ends with its request."""
        path = f"/api/v1/uploads/{quote(str(id), safe='/')}/scene/draft"
        return self._send('POST', path, body)

    def run_polarization(self, body: Any = None) -> Any:
        """Orientation of gratings from photographs behind a turning analyser, or from a polarization sensor."""
        path = '/api/v1/operations/polarization'
        return self._send('POST', path, body)

    def run_hdr(self, body: Any = None) -> Any:
        """One photograph of high dynamic range from several exposures."""
        path = '/api/v1/operations/hdr'
        return self._send('POST', path, body)

    def run_stack(self, body: Any = None) -> Any:
        """Mean, median and noise of a series of photographs, without outliers."""
        path = '/api/v1/operations/stack'
        return self._send('POST', path, body)

    def run_lut(self, body: Any = None) -> Any:
        """Lookup table of a diffraction pattern under any light, from one photograph in narrow-band light."""
        path = '/api/v1/operations/lut'
        return self._send('POST', path, body)

    def run_bokeh(self, body: Any = None) -> Any:
        """Height and lines of a grating, from a photograph of an out-of-focus highlight on it."""
        path = '/api/v1/operations/bokeh'
        return self._send('POST', path, body)

    def run_foil(self, body: Any = None) -> Any:
        """Distribution of orientations and periods of a foil's random dots, from one photograph under a flash."""
        path = '/api/v1/operations/foil'
        return self._send('POST', path, body)

    def run_spots(self, body: Any = None) -> Any:
        """Orientation and absolute period of gratings from fringes on the panel."""
        path = '/api/v1/operations/spots'
        return self._send('POST', path, body)

    def run_flash(self, body: Any = None) -> Any:
        """Orientation and absolute period of gratings on a sheet of repeated tiles, from photographs under a flash."""
        path = '/api/v1/operations/flash'
        return self._send('POST', path, body)

    def run_brdf(self, body: Any = None) -> Any:
        """Picture of the light that a height field diffracts into all directions."""
        path = '/api/v1/operations/brdf'
        return self._send('POST', path, body)

    def run_map(self, body: Any = None) -> Any:
        """Edited maps of orientation and period."""
        path = '/api/v1/operations/map'
        return self._send('POST', path, body)

    def run_calibrate(self, body: Any = None) -> Any:
        """Camera, sample and light, from photographs of a board and of the light in a mirror."""
        path = '/api/v1/operations/calibrate'
        return self._send('POST', path, body)

    def run_render(self, body: Any = None) -> Any:
        """Picture of a scene: measured and invented surfaces under any light."""
        path = '/api/v1/operations/render'
        return self._send('POST', path, body)

    def run_factor(self, body: Any = None) -> Any:
        """Separable terms of a lookup table, for environment lighting."""
        path = '/api/v1/operations/factor'
        return self._send('POST', path, body)

    def run_synthesize(self, body: Any = None) -> Any:
        """Maps of new foil, drawn from a measured distribution of random dots."""
        path = '/api/v1/operations/synthesize'
        return self._send('POST', path, body)

    def run_inspect(self, body: Any = None) -> Any:
        """Defects of a sheet, by comparison with a reference."""
        path = '/api/v1/operations/inspect'
        return self._send('POST', path, body)

    def run_camera(self, body: Any = None) -> Any:
        """Noise of a camera, from photographs of even light and of darkness."""
        path = '/api/v1/operations/camera'
        return self._send('POST', path, body)

    def run_flat(self, body: Any = None) -> Any:
        """Flat field of light and lens, from photographs of a uniform surface."""
        path = '/api/v1/operations/flat'
        return self._send('POST', path, body)

    def run_analyser(self, body: Any = None) -> Any:
        """Zero and extinction of the analyser, from photographs of a reference polarizer."""
        path = '/api/v1/operations/analyser'
        return self._send('POST', path, body)

    def run_retarder(self, body: Any = None) -> Any:
        """Azimuth and retardance of the panel's film, from the polarization of its light."""
        path = '/api/v1/operations/retarder'
        return self._send('POST', path, body)

    def run_orientation(self, body: Any = None) -> Any:
        """Offset of orientations, from a map of a sample of known orientation."""
        path = '/api/v1/operations/orientation'
        return self._send('POST', path, body)
