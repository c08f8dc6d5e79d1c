//! A graphics card, without a window.

use super::{Prepared, SHADER, Texture};
use std::sync::mpsc;
use wgpu::util::{BufferInitDescriptor, DeviceExt, TextureDataOrder};

/// Bytes of a pixel of the picture.
const PIXEL: u32 = 16;

/// Uniforms that do not change while a scene is rendered, as shaders read them.
const SETTLED: [(&str, &str, usize); 4] = [
    ("scene.what.x", "what", 0),
    ("scene.what.y", "what", 1),
    ("scene.form.x", "form", 0),
    ("scene.sky_x.w", "sky_x", 3),
];

/// A scene on a card.
pub(in super::super) struct Card {
    device: wgpu::Device,
    queue: wgpu::Queue,
    name: String,
    software: bool,
    /// Shaders before what is settled is put into them.
    shader: String,
    program: Program,
    loaded: Loaded,
}

/// Shaders as they are compiled: the same for all scenes that settle the same.
struct Program {
    text: String,
    textures: usize,
    layout: wgpu::BindGroupLayout,
    pipeline: wgpu::RenderPipeline,
}

/// What is one scene's.
struct Loaded {
    prepared: Prepared,
    uniforms: wgpu::Buffer,
    group: wgpu::BindGroup,
    target: wgpu::Texture,
    readback: wgpu::Buffer,
}

/// The best card there is, or why there is none.
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

/// What the best card is called and how it is reached, or why there is none.
pub(in super::super) fn name() -> Result<String, String> {
    adapter().map(|adapter| called(&adapter.get_info()))
}

/// Says why a card does not take a scene: sums are too long for software, or a texture or the picture is too large.
fn fits(device: &wgpu::Device, name: &str, software: bool, prepared: &Prepared) -> Result<(), String> {
    if software && prepared.too_long_for_software() {
        return Err(format!("{name} is software that ends long sums early, as this scene takes"));
    }
    let most = device.limits().max_texture_dimension_2d as usize;
    let sizes = prepared.textures.iter().map(|t| (t.name, t.width.max(t.height)));
    for (name, side) in sizes.chain([("picture", prepared.size[0].max(prepared.size[1]))]) {
        if side > most {
            return Err(format!("{name} has {side} pixels along a side, and the card takes {most}"));
        }
    }
    let bytes = row_bytes(prepared.size[0]) as u64 * prepared.size[1] as u64;
    if bytes > device.limits().max_buffer_size {
        return Err("the picture is too large for the card".into());
    }
    Ok(())
}

/// What is made on a card, or the error that it gives.
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

/// Bytes of a row as it is copied.
fn row_bytes(width: usize) -> u32 {
    (width as u32 * PIXEL).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT)
}

fn size([width, height]: [usize; 2]) -> wgpu::Extent3d {
    wgpu::Extent3d { width: width as u32, height: height as u32, depth_or_array_layers: 1 }
}

fn descriptor(size: wgpu::Extent3d, channels: usize, usage: wgpu::TextureUsages) -> wgpu::TextureDescriptor<'static> {
    wgpu::TextureDescriptor {
        label: None,
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: if channels == 1 { wgpu::TextureFormat::R32Float } else { wgpu::TextureFormat::Rgba32Float },
        usage,
        view_formats: &[],
    }
}

/// Shaders with numbers in place of what is settled, so that compilers leave out what is not this scene's.
fn settled(prepared: &Prepared, shader: &str) -> String {
    let number = |name: &str, k: usize| format!("{:?}", prepared.value(name)[k]);
    SETTLED.iter().fold(shader.to_owned(), |text, (read, name, k)| text.replace(read, &number(name, *k)))
}

impl Card {
    /// The best card there is, with a scene on it; or why there is none.
    pub(in super::super) fn new(prepared: Prepared) -> Result<Self, String> {
        Self::with(prepared, SHADER)
    }

    /// The same with other shaders, whose entry points are called the same.
    pub(in super::super) fn with(prepared: Prepared, shader: &str) -> Result<Self, String> {
        let adapter = adapter()?;
        let info = adapter.get_info();
        let limits = wgpu::Limits::downlevel_defaults().using_resolution(adapter.limits());
        let limits = wgpu::Limits { max_buffer_size: adapter.limits().max_buffer_size, ..limits };
        let wanted = wgpu::DeviceDescriptor { required_limits: limits, ..wgpu::DeviceDescriptor::default() };
        let (device, queue) =
            pollster::block_on(adapter.request_device(&wanted)).map_err(|e| format!("{} refuses: {e}", info.name))?;
        // Without this, wgpu ends the program on an error; each of ours is asked for below.
        device.on_uncaptured_error(std::sync::Arc::new(|_| ()));
        let (name, software) = (called(&info), info.device_type == wgpu::DeviceType::Cpu);
        fits(&device, &name, software, &prepared)?;
        let (program, loaded) = caught(&device, &name, || {
            let program = Program::new(&device, &prepared, settled(&prepared, shader));
            let loaded = Loaded::new(&device, &queue, &program.layout, prepared);
            (program, loaded)
        })?;
        Ok(Self { device, queue, name, software, shader: shader.to_owned(), program, loaded })
    }

    /// Puts another scene in place of the one it has; shaders are compiled anew only if they are others. The card keeps what it had if this fails.
    pub(in super::super) fn load(&mut self, prepared: Prepared) -> Result<(), String> {
        fits(&self.device, &self.name, self.software, &prepared)?;
        let text = settled(&prepared, &self.shader);
        let same = text == self.program.text && prepared.textures.len() == self.program.textures;
        let (program, loaded) = caught(&self.device, &self.name, || {
            let program = (!same).then(|| Program::new(&self.device, &prepared, text));
            let layout = &program.as_ref().unwrap_or(&self.program).layout;
            let loaded = Loaded::new(&self.device, &self.queue, layout, prepared);
            (program, loaded)
        })?;
        self.loaded = loaded;
        if let Some(program) = program {
            self.program = program;
        }
        Ok(())
    }

    /// What it is called, and how it is reached.
    pub(in super::super) fn name(&self) -> &str {
        &self.name
    }

    /// Whether it is software that stands in for a card.
    pub(in super::super) fn software(&self) -> bool {
        self.software
    }

    /// Means of some samples of each pixel, linear sRGB, row by row from the top.
    pub(in super::super) fn pass(&mut self, first: usize, count: usize) -> Result<Vec<[f32; 3]>, String> {
        let mut sum = vec![[0.0; 3]; self.loaded.prepared.size[0] * self.loaded.prepared.size[1]];
        for k in 0..count {
            let sample = self.sample(first + k, self.loaded.prepared.size)?;
            for (sum, rgb) in sum.iter_mut().zip(sample) {
                (0..3).for_each(|c| sum[c] += rgb[c] / count as f32);
            }
        }
        Ok(sum)
    }

    /// Seconds of frames of one sample each, of whose pixels only `part` in the middle are drawn; nothing is read back.
    pub(in super::super) fn seconds(&mut self, frames: usize, part: [usize; 2]) -> Result<f64, String> {
        let begun = std::time::Instant::now();
        for k in 0..frames {
            let commands = self.begun(k, part);
            self.queue.submit([commands.finish()]);
        }
        self.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| format!("the card gave up: {e}"))?;
        Ok(begun.elapsed().as_secs_f64())
    }

    /// One sample of each pixel of a part in the middle: systems end what keeps a card busy for seconds.
    pub(in super::super) fn sample(&mut self, index: usize, part: [usize; 2]) -> Result<Vec<[f32; 3]>, String> {
        let mut commands = self.begun(index, part);
        let row = row_bytes(self.loaded.prepared.size[0]);
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None };
        let to = wgpu::TexelCopyBufferInfo { buffer: &self.loaded.readback, layout };
        commands.copy_texture_to_buffer(self.loaded.target.as_image_copy(), to, size(self.loaded.prepared.size));
        self.queue.submit([commands.finish()]);
        let (done, ended) = mpsc::channel();
        self.loaded.readback.map_async(wgpu::MapMode::Read, .., move |result| drop(done.send(result)));
        let lost = |error: &dyn std::fmt::Display| format!("the card gave up: {error}");
        self.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| lost(&e))?;
        ended.recv().map_err(|e| lost(&e))?.map_err(|e| lost(&e))?;
        let bytes = self.loaded.readback.get_mapped_range(..).map_err(|e| lost(&e))?;
        let width = self.loaded.prepared.size[0] * PIXEL as usize;
        let rows = bytes.chunks_exact(row as usize).flat_map(|row| row[..width].chunks_exact(PIXEL as usize));
        let number = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        let pixels = rows.map(|p| [number(&p[..4]), number(&p[4..8]), number(&p[8..12])]).collect();
        drop(bytes);
        self.loaded.readback.unmap();
        Ok(pixels)
    }

    /// Commands that draw a sample of a part in the middle.
    fn begun(&mut self, index: usize, part: [usize; 2]) -> wgpu::CommandEncoder {
        self.loaded.prepared.samples(index, 1, 0.0);
        self.queue.write_buffer(&self.loaded.uniforms, 0, &self.loaded.prepared.uniform_bytes());
        let mut commands = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        self.draw(&mut commands, part);
        commands
    }

    fn draw(&self, commands: &mut wgpu::CommandEncoder, part: [usize; 2]) {
        let view = self.loaded.target.create_view(&wgpu::TextureViewDescriptor::default());
        let mut pass = commands.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store },
            })],
            ..wgpu::RenderPassDescriptor::default()
        });
        pass.set_pipeline(&self.program.pipeline);
        pass.set_bind_group(0, &self.loaded.group, &[]);
        let [left, top] = [0, 1].map(|k| (self.loaded.prepared.size[k] - part[k]) as u32 / 2);
        pass.set_scissor_rect(left, top, part[0] as u32, part[1] as u32);
        pass.draw(0..3, 0..1);
    }
}

impl Program {
    fn new(device: &wgpu::Device, prepared: &Prepared, text: String) -> Self {
        let textures = prepared.textures.len();
        // One more: the samples before.
        let layout = layout(device, textures + 1);
        let pipeline = pipeline(device, &layout, &text);
        Self { text, textures, layout, pipeline }
    }
}

impl Loaded {
    fn new(device: &wgpu::Device, queue: &wgpu::Queue, layout: &wgpu::BindGroupLayout, prepared: Prepared) -> Self {
        use wgpu::{BufferUsages, TextureUsages};
        let uniforms = device.create_buffer_init(&BufferInitDescriptor {
            label: None,
            contents: &prepared.uniform_bytes(),
            usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
        });
        // The samples before are added up by the processor: no picture of them is looked at.
        let before = Texture { name: "before", width: 1, height: 1, channels: 4, values: vec![0.0; 4] };
        let views: Vec<wgpu::TextureView> = prepared
            .textures
            .iter()
            .chain([&before])
            .map(|t| {
                let kind = descriptor(size([t.width, t.height]), t.channels, TextureUsages::TEXTURE_BINDING);
                let bytes = bytemuck::cast_slice(&t.values);
                let texture = device.create_texture_with_data(queue, &kind, TextureDataOrder::LayerMajor, bytes);
                texture.create_view(&wgpu::TextureViewDescriptor::default())
            })
            .collect();
        let target = TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC;
        let target = device.create_texture(&descriptor(size(prepared.size), 4, target));
        let readback = device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(row_bytes(prepared.size[0])) * prepared.size[1] as u64,
            usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let buffer = wgpu::BindGroupEntry { binding: 0, resource: uniforms.as_entire_binding() };
        let textures = views.iter().zip(1..).map(|(view, binding)| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::TextureView(view),
        });
        let entries: Vec<wgpu::BindGroupEntry> = [buffer].into_iter().chain(textures).collect();
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries });
        Self { prepared, uniforms, group, target, readback }
    }
}

fn layout(device: &wgpu::Device, textures: usize) -> wgpu::BindGroupLayout {
    let entry = |binding: u32, ty: wgpu::BindingType| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::FRAGMENT,
        ty,
        count: None,
    };
    let uniform = wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let texture = wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable: false },
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    let textures = (1..=textures as u32).map(|binding| entry(binding, texture));
    let entries: Vec<wgpu::BindGroupLayoutEntry> = [entry(0, uniform)].into_iter().chain(textures).collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries })
}

fn pipeline(device: &wgpu::Device, layout: &wgpu::BindGroupLayout, shader: &str) -> wgpu::RenderPipeline {
    let source = wgpu::ShaderSource::Wgsl(shader.into());
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        bind_group_layouts: &[Some(layout)],
        ..wgpu::PipelineLayoutDescriptor::default()
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some("corner"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some("light"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(wgpu::TextureFormat::Rgba32Float.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}
