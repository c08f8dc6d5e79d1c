// A client of typed paths, which were generated from the OpenAPI document. Orders follow below: they must fit their operation's schema.

import type { paths } from "./openapi.js";

type Operation = Extract<keyof paths, `/api/v1/operations/${string}`> & keyof Orders;
type Orders = { [P in keyof paths]: paths[P] extends { post: { requestBody: { content: { "application/json": infer O } } } } ? O : never };
type Job = paths["/api/v1/reconstructions/{id}"]["get"]["responses"][200]["content"]["application/json"];

declare const process: { argv: string[] };

const base = process.argv[2];

async function call<T>(path: string, body?: unknown): Promise<T> {
  const init = body === undefined ? {} : { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
  const answer = await fetch(base + path, init);
  if (!answer.ok) throw new Error(`${path}: ${await answer.text()}`);
  return answer.json();
}

async function run<P extends Operation>(path: P, order: Orders[P]): Promise<void> {
  let job = await call<Job>(path, order);
  while (!["done", "failed", "set_aside"].includes(job.state)) {
    await new Promise((resolve) => setTimeout(resolve, 100));
    job = await call<Job>(`/api/v1/reconstructions/${job.id}`);
  }
  if (job.state !== "done") throw new Error(`${path}: ${job.error}`);
}

