// Types of what elements are made of, and of browsers' features that the checker's library does not know yet. Nothing of it is served.

/** Attributes by name; functions are listeners, named `onclick` and so on. False and null leave one out. */
type Attributes = Record<string, string | number | boolean | null | undefined | ((event: any) => unknown)>;
/** What an element can hold; what is false or null is left out. */
type Child = Node | string | number | boolean | null | undefined | readonly Child[];

/** How a request is sent. */
interface Sending {
    method?: string;
    body?: BodyInit;
    headers?: Record<string, string>;
    signal?: AbortSignal;
    keepalive?: boolean;
}

/** What each page is given beside the element that it fills. */
interface Visit {
    id: string;
    signal: AbortSignal;
}

/** How signals are made; younger than the checker's library. */
interface Signals {
    any(signals: AbortSignal[]): AbortSignal;
    timeout(ms: number): AbortSignal;
}

declare class OffscreenCanvas {
    constructor(width: number, height: number);
    getContext(kind: "2d", settings?: CanvasRenderingContext2DSettings): CanvasRenderingContext2D;
}

declare class CompressionStream {
    constructor(format: "deflate");
    readable: ReadableStream<Uint8Array>;
    writable: WritableStream<Uint8Array>;
}

declare class DecompressionStream {
    constructor(format: "gzip");
    readable: ReadableStream<Uint8Array>;
    writable: WritableStream<Uint8Array>;
}

interface Navigator {
    wakeLock?: { request(kind: "screen"): Promise<unknown> };
}
