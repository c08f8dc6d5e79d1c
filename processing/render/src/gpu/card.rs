//! Rendering on a graphics card, without a window.

use super::{Prepared, SHADER, Texture};
use std::sync::mpsc;
use wgpu::util::{BufferInitDescriptor, DeviceExt, TextureDataOrder};

/// Bytes per pixel of the picture.
const PIXEL: u64 = 16;

/// Uniforms that are constant while a scene is rendered, with the shader expressions that read them.
const SETTLED: [(&str, &str, usize); 4] = [
    ("scene.what.x", "what", 0),
    ("scene.what.y", "what", 1),
    ("scene.form.x", "form", 0),
    ("scene.sky_x.w", "sky_x", 3),
];

/// Adds a sample, computed by the shaders' `drawn`, to the sums of the pixels. A compute shader is used because drawing
/// triangles took a server card 5 to 50 times as long (docs/validation/graphics-cards.md). The sums also stay on the
/// card between samples.
const ADDS: &str = "
struct Area {
    first: vec2<u32>,
    size: vec2<u32>,
    width: u32,
}
@group(1) @binding(0) var<uniform> area: Area;
@group(1) @binding(1) var<storage, read_write> picture: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn add(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= area.size.x || id.y >= area.size.y {
        return;
    }
    let at = area.first + id.xy;
    picture[at.y * area.width + at.x] += drawn(vec2<f32>(at));
}";

/// Samples queued before waiting for the card.
const AHEAD: usize = 256;

/// Pixels along a side of a workgroup.
const GROUP: u32 = 8;

/// Bytes of an `Area`.
const AREA: u64 = 32;

/// A scene on a graphics card.
pub(in super::super) struct Card {
    device: wgpu::Device,
    queue: wgpu::Queue,
    name: String,
    software: bool,
    /// Shader source before constants are substituted.
    shader: String,
    program: Program,
    loaded: Loaded,
}

/// Compiled shaders, shared by all scenes with the same constants.
struct Program {
    text: String,
    pipeline: wgpu::ComputePipeline,
}

/// Resources of one scene.
struct Loaded {
    prepared: Prepared,
    uniforms: wgpu::Buffer,
    area: wgpu::Buffer,
    /// Sums of the samples.
    picture: wgpu::Buffer,
    readback: wgpu::Buffer,
    groups: [wgpu::BindGroup; 2],
}

/// The best available card, or the reason why there is none.
fn adapter() -> Result<wgpu::Adapter, String> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
    let wanted = wgpu::RequestAdapterOptions {
        power_preference: wgpu::PowerPreference::HighPerformance,
        ..wgpu::RequestAdapterOptions::default()
    };
    pollster::block_on(instance.request_adapter(&wanted))
        .map_err(|error| format!("there is no graphics card that can be used ({error})"))
}

fn called(info: &wgpu::AdapterInfo) -> String {
    format!("{} ({})", info.name, info.backend)
}

/// Name and backend of the best card, or the reason why there is none.
pub(in super::super) fn name() -> Result<String, String> {
    adapter().map(|adapter| called(&adapter.get_info()))
}

/// Checks whether a card can render a scene: sums may be too long for a software renderer, and a texture or the picture
/// too large.
fn fits(device: &wgpu::Device, name: &str, software: bool, prepared: &Prepared) -> Result<(), String> {
    if software && prepared.too_long_for_software() {
        return Err(format!("{name} is software that ends long sums early, as this scene takes"));
    }
    let limits = device.limits();
    for t in &prepared.textures {
        let (side, most) = (t.width.max(t.height), limits.max_texture_dimension_2d as usize);
        if side > most {
            return Err(format!("{} has {side} pixels along a side, and the card takes {most}", t.name));
        }
    }
    let [columns, rows] = prepared.size.map(|n| n as u64);
    let groups = columns.max(rows).div_ceil(u64::from(GROUP));
    let most = limits.max_buffer_size.min(limits.max_storage_buffer_binding_size);
    let fits = picture_bytes(prepared.size) <= most && groups <= u64::from(limits.max_compute_workgroups_per_dimension);
    if fits { Ok(()) } else { Err(format!("a picture of {columns} × {rows} pixels is too large for the card")) }
}

/// Bytes of the sums of all pixels.
fn picture_bytes([width, height]: [usize; 2]) -> u64 {
    (width as u64).saturating_mul(height as u64).saturating_mul(PIXEL)
}

/// Creates resources on a card, and returns the card's error if one occurs.
fn caught<T>(device: &wgpu::Device, name: &str, make: impl FnOnce() -> T) -> Result<T, String> {
    let memory = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
    let invalid = device.push_error_scope(wgpu::ErrorFilter::Validation);
    let made = make();
    let wrong = [pollster::block_on(invalid.pop()), pollster::block_on(memory.pop())];
    match wrong.into_iter().flatten().next() {
        Some(error) => Err(format!("{name} does not do it: {error}")),
        None => Ok(made),
    }
}

fn descriptor(t: &Texture) -> wgpu::TextureDescriptor<'static> {
    wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: t.width as u32, height: t.height as u32, depth_or_array_layers: 1 },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: if t.channels == 1 { wgpu::TextureFormat::R32Float } else { wgpu::TextureFormat::Rgba32Float },
        usage: wgpu::TextureUsages::TEXTURE_BINDING,
        view_formats: &[],
    }
}

/// Substitutes constants into the shaders, so that compilers remove code that this scene does not need.
fn settled(prepared: &Prepared, shader: &str) -> String {
    let number = |name: &str, k: usize| format!("{:?}", prepared.value(name)[k]);
    SETTLED.iter().fold(shader.to_owned(), |text, (read, name, k)| text.replace(read, &number(name, *k)))
}

impl Card {
    /// Loads a scene onto the best card, or returns the reason why that is not possible.
    pub(in super::super) fn new(prepared: Prepared) -> Result<Self, String> {
        Self::with(prepared, SHADER)
    }

    /// As [`Self::new`], with other shaders that define `drawn` at a pixel.
    pub(in super::super) fn with(prepared: Prepared, shader: &str) -> Result<Self, String> {
        let adapter = adapter()?;
        let info = adapter.get_info();
        let of_card = adapter.limits();
        let limits = wgpu::Limits {
            max_buffer_size: of_card.max_buffer_size,
            max_storage_buffer_binding_size: of_card.max_storage_buffer_binding_size,
            ..wgpu::Limits::downlevel_defaults().using_resolution(of_card)
        };
        let wanted = wgpu::DeviceDescriptor { required_limits: limits, ..wgpu::DeviceDescriptor::default() };
        let (device, queue) =
            pollster::block_on(adapter.request_device(&wanted)).map_err(|e| format!("{} refuses: {e}", info.name))?;
        // Without this handler wgpu aborts on an error; errors of each call are checked below.
        device.on_uncaptured_error(std::sync::Arc::new(|_| ()));
        let (name, software) = (called(&info), info.device_type == wgpu::DeviceType::Cpu);
        fits(&device, &name, software, &prepared)?;
        let (program, loaded) = caught(&device, &name, || {
            let program = Program::new(&device, &prepared, settled(&prepared, shader));
            let loaded = Loaded::new(&device, &queue, &program.pipeline, prepared);
            (program, loaded)
        })?;
        Ok(Self { device, queue, name, software, shader: shader.to_owned(), program, loaded })
    }

    /// Replaces the scene. Shaders are recompiled only if they differ. On failure the previous scene is kept.
    pub(in super::super) fn load(&mut self, prepared: Prepared) -> Result<(), String> {
        fits(&self.device, &self.name, self.software, &prepared)?;
        let text = settled(&prepared, &self.shader);
        let other = text != self.program.text;
        let (program, loaded) = caught(&self.device, &self.name, || {
            let program = other.then(|| Program::new(&self.device, &prepared, text));
            let pipeline = &program.as_ref().unwrap_or(&self.program).pipeline;
            let loaded = Loaded::new(&self.device, &self.queue, pipeline, prepared);
            (program, loaded)
        })?;
        self.loaded = loaded;
        if let Some(program) = program {
            self.program = program;
        }
        Ok(())
    }

    /// Name and backend of the card.
    pub(in super::super) fn name(&self) -> &str {
        &self.name
    }

    /// Whether the adapter is a software renderer.
    pub(in super::super) fn software(&self) -> bool {
        self.software
    }

    /// Means of `count` samples of each pixel, linear sRGB, row by row from the top.
    pub(in super::super) fn pass(&mut self, first: usize, count: usize) -> Result<Vec<[f32; 3]>, String> {
        self.part(first, count, self.loaded.prepared.size)
    }

    /// As [`Self::pass`], for a central part of the picture, with zeros around it.
    pub(in super::super) fn part(
        &mut self,
        first: usize,
        count: usize,
        part: [usize; 2],
    ) -> Result<Vec<[f32; 3]>, String> {
        let mut commands = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        commands.clear_buffer(&self.loaded.picture, 0, None);
        self.queue.submit([commands.finish()]);
        self.add(first, count, part)?;
        let Loaded { picture, readback, prepared, .. } = &self.loaded;
        let mut commands = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        commands.copy_buffer_to_buffer(picture, 0, readback, 0, picture_bytes(prepared.size));
        self.queue.submit([commands.finish()]);
        let (done, ended) = mpsc::channel();
        readback.map_async(wgpu::MapMode::Read, .., move |result| drop(done.send(result)));
        waited(&self.device)?;
        ended.recv().map_err(|e| lost(&e))?.map_err(|e| lost(&e))?;
        let bytes = readback.get_mapped_range(..).map_err(|e| lost(&e))?;
        let number = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]) / count as f32;
        let sums = bytes.chunks_exact(PIXEL as usize);
        let pixels = sums.map(|p| [number(&p[..4]), number(&p[4..8]), number(&p[8..12])]).collect();
        drop(bytes);
        readback.unmap();
        Ok(pixels)
    }

    /// Time in s of `frames` frames with one sample each; only the central `part` is drawn, and nothing is read back.
    pub(in super::super) fn seconds(&mut self, frames: usize, part: [usize; 2]) -> Result<f64, String> {
        let begun = std::time::Instant::now();
        self.add(0, frames, part)?;
        waited(&self.device)?;
        Ok(begun.elapsed().as_secs_f64())
    }

    /// Adds samples of a central part one at a time, because systems reset a card that is busy for seconds.
    fn add(&mut self, first: usize, count: usize, part: [usize; 2]) -> Result<(), String> {
        let Loaded { prepared, uniforms, area, groups, .. } = &mut self.loaded;
        let [width, left, top] =
            [prepared.size[0], (prepared.size[0] - part[0]) / 2, (prepared.size[1] - part[1]) / 2].map(|n| n as u32);
        let [columns, rows] = part.map(|n| n as u32);
        self.queue.write_buffer(area, 0, bytemuck::cast_slice(&[left, top, columns, rows, width, 0, 0, 0]));
        for k in 0..count {
            prepared.samples(first + k, 1, 0.0);
            self.queue.write_buffer(uniforms, 0, &prepared.uniform_bytes());
            let mut commands = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let mut pass = commands.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&self.program.pipeline);
            (0..).zip(&*groups).for_each(|(k, group)| pass.set_bind_group(k, group, &[]));
            pass.dispatch_workgroups(columns.div_ceil(GROUP), rows.div_ceil(GROUP), 1);
            drop(pass);
            self.queue.submit([commands.finish()]);
            if k % AHEAD == AHEAD - 1 {
                waited(&self.device)?;
            }
        }
        Ok(())
    }
}

/// Waits until the card has completed all submitted work.
fn waited(device: &wgpu::Device) -> Result<(), String> {
    device.poll(wgpu::PollType::wait_indefinitely()).map(drop).map_err(|e| lost(&e))
}

fn lost(error: &dyn std::fmt::Display) -> String {
    format!("the card gave up: {error}")
}

impl Program {
    fn new(device: &wgpu::Device, prepared: &Prepared, text: String) -> Self {
        let source = wgpu::ShaderSource::Wgsl((text.clone() + ADDS).into());
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
        // One additional texture: the previous samples.
        let layouts = [scene_layout(device, prepared.textures.len() + 1), picture_layout(device)];
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            bind_group_layouts: &layouts.each_ref().map(Some),
            ..wgpu::PipelineLayoutDescriptor::default()
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: Some(&layout),
            module: &module,
            entry_point: Some("add"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        Self { text, pipeline }
    }
}

impl Loaded {
    fn new(device: &wgpu::Device, queue: &wgpu::Queue, pipeline: &wgpu::ComputePipeline, prepared: Prepared) -> Self {
        use wgpu::BufferUsages;
        let uniforms = device.create_buffer_init(&BufferInitDescriptor {
            label: None,
            contents: &prepared.uniform_bytes(),
            usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
        });
        let buffer = |size, usage| {
            device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
        };
        let area = buffer(AREA, BufferUsages::UNIFORM | BufferUsages::COPY_DST);
        let bytes = picture_bytes(prepared.size);
        let picture = buffer(bytes, BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST);
        let readback = buffer(bytes, BufferUsages::COPY_DST | BufferUsages::MAP_READ);
        // The sums are outside the shaders, so the texture of previous samples is unused.
        let before = Texture { name: "before", width: 1, height: 1, channels: 4, values: vec![0.0; 4] };
        let views: Vec<wgpu::TextureView> = prepared
            .textures
            .iter()
            .chain([&before])
            .map(|t| {
                let bytes = bytemuck::cast_slice(&t.values);
                let texture =
                    device.create_texture_with_data(queue, &descriptor(t), TextureDataOrder::LayerMajor, bytes);
                texture.create_view(&wgpu::TextureViewDescriptor::default())
            })
            .collect();
        let textures = views.iter().map(wgpu::BindingResource::TextureView);
        let of_scene: Vec<_> = [uniforms.as_entire_binding()].into_iter().chain(textures).collect();
        let of_picture = vec![area.as_entire_binding(), picture.as_entire_binding()];
        let groups = [(0, of_scene), (1, of_picture)].map(|(k, resources)| {
            let entries = (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource });
            device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &pipeline.get_bind_group_layout(k),
                entries: &entries.collect::<Vec<_>>(),
            })
        });
        Self { prepared, uniforms, area, picture, readback, groups }
    }
}

fn layout(device: &wgpu::Device, types: &[wgpu::BindingType]) -> wgpu::BindGroupLayout {
    let entries = (0..).zip(types).map(|(binding, ty)| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: *ty,
        count: None,
    });
    let entries: Vec<_> = entries.collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries })
}

fn buffer(ty: wgpu::BufferBindingType) -> wgpu::BindingType {
    wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None }
}

/// Layout of the scene's uniforms and textures.
fn scene_layout(device: &wgpu::Device, textures: usize) -> wgpu::BindGroupLayout {
    let texture = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable: false },
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    let mut types = vec![texture; textures + 1];
    types[0] = buffer(wgpu::BufferBindingType::Uniform);
    layout(device, &types)
}

/// Layout of the area and the sums of the pixels.
fn picture_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    layout(
        device,
        &[buffer(wgpu::BufferBindingType::Uniform), buffer(wgpu::BufferBindingType::Storage { read_only: false })],
    )
}
