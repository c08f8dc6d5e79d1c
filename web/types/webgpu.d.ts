// WebGPU as far as the viewer uses it; younger than the checker's library. Nothing of it is served.

interface GpuTexture {
    createView(): object;
    destroy(): void;
}

interface GpuContext {
    configure(settings: { device: GpuDevice; format: string; alphaMode: string }): void;
    unconfigure(): void;
    getCurrentTexture(): GpuTexture;
}

interface GpuDevice {
    limits: { maxTextureDimension2D: number };
    lost: Promise<{ reason: string; message: string }>;
    queue: {
        submit(commands: object[]): void;
        writeBuffer(buffer: any, offset: number, values: Float32Array): void;
        writeTexture(to: { texture: GpuTexture }, values: Float32Array, layout: { bytesPerRow: number }, size: number[]): void;
        onSubmittedWorkDone(): Promise<void>;
    };
    createBuffer(settings: { size: number; usage: number }): any;
    createTexture(settings: { size: number[]; format: string; usage: number }): GpuTexture;
    createShaderModule(settings: { code: string }): object;
    createBindGroupLayout(settings: object): object;
    createPipelineLayout(settings: object): object;
    createBindGroup(settings: object): object;
    createRenderPipeline(settings: object): any;
    createRenderPipelineAsync(settings: object): Promise<any>;
    createCommandEncoder(): any;
    addEventListener(kind: "uncapturederror", told: (event: { error: Error }) => void): void;
    destroy(): void;
}

interface Gpu {
    requestAdapter(settings: { powerPreference: string }): Promise<{
        limits: { maxTextureDimension2D: number };
        requestDevice(settings: object): Promise<GpuDevice>;
    } | null>;
    getPreferredCanvasFormat(): string;
}

interface Navigator {
    gpu?: Gpu;
}

interface HTMLCanvasElement {
    getContext(kind: "webgpu"): GpuContext | null;
}
