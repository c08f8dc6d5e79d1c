//! Triangle meshes with normals and tangents, in a bounding-volume hierarchy.

use crate::shape::mesh_file::LeftOut;
use crate::shape::ray::{Hit, Ray};
use crate::vector::V3;
use nacre_base::{Error, Result};

/// Maximum number of triangles of a mesh.
pub(crate) const MAX_TRIANGLES: usize = 20_000_000;

/// Maximum number of triangles in a leaf.
const LEAF: usize = 4;

/// A triangle corner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Corner {
    pub place: V3,
    pub normal: Option<V3>,
    /// Direction of u.
    pub tangent: Option<V3>,
    pub uv: Option<[f64; 2]>,
}

/// Triangles as read from a file.
pub(crate) struct Raw {
    /// File name for error messages.
    pub name: String,
    pub corners: Vec<Corner>,
    pub triangles: Vec<[u32; 3]>,
    /// Parts of the file that were not read.
    pub left_out: LeftOut,
}

/// A corner with all shading attributes.
#[derive(Clone, Copy)]
struct Shaded {
    place: V3,
    normal: V3,
    tangent: V3,
    uv: [f64; 2],
}

struct Node {
    low: V3,
    high: V3,
    /// First triangle and number of triangles of a leaf; otherwise the second child (the first child follows the node).
    first: usize,
    count: usize,
}

/// A mesh prepared for ray tracing.
pub(crate) struct Mesh {
    corners: Vec<Shaded>,
    triangles: Vec<[u32; 3]>,
    nodes: Vec<Node>,
    /// Parts of the file that are not rendered, including degenerate triangles.
    pub left_out: LeftOut,
    /// Whether the direction of u is known, given or from (u, v).
    pub tangents: bool,
}

impl Raw {
    /// Rotates, scales and moves all corners.
    pub(crate) fn place(&mut self, turn: impl Fn(V3) -> V3, scale: f64, at: V3) {
        for corner in &mut self.corners {
            corner.place = turn(corner.place) * scale + at;
            corner.normal = corner.normal.map(&turn);
            corner.tangent = corner.tangent.map(&turn);
        }
    }

    fn refuse(&self, problem: String, remedy: &str) -> Error {
        Error::input(&self.name, problem, remedy)
    }

    /// Checks the triangles, computes missing attributes, and builds the hierarchy.
    ///
    /// # Errors
    /// `Input` for non-finite coordinates, missing corners, too many triangles, and meshes without area.
    pub(crate) fn finished(mut self) -> Result<Mesh> {
        if self.triangles.len() > MAX_TRIANGLES || self.corners.len() > MAX_TRIANGLES {
            let problem = format!("has {} triangles and {} corners", self.triangles.len(), self.corners.len());
            return Err(self.refuse(problem, "give a mesh of at most 20 million triangles"));
        }
        let finite = |v: &V3| v.iter().all(|c| c.abs() < 1e9);
        if let Some(k) = self.corners.iter().position(|c| !finite(&c.place)) {
            let problem = format!("has corner {k} at {:?}", self.corners[k].place.as_slice());
            return Err(self.refuse(problem, "give finite coordinates, in scale below 1e9"));
        }
        if let Some(t) = self.triangles.iter().find(|t| t.iter().any(|k| *k as usize >= self.corners.len())) {
            let problem = format!("has the triangle {t:?} and only {} corners", self.corners.len());
            return Err(self.refuse(problem, "mend the mesh"));
        }
        let all = self.triangles.len();
        let corners = &self.corners;
        let place = |k: u32| corners[k as usize].place;
        self.triangles.retain(|t| has_area(t.map(place)));
        if self.triangles.is_empty() {
            return Err(self.refuse(format!("has {all} triangles, none with an area"), "give a mesh of triangles"));
        }
        self.left_out.add("triangle without an area", all - self.triangles.len());
        let tangents = self.corners.iter().all(|c| c.tangent.is_some() || c.uv.is_some());
        let corners = self.shaded();
        let mut mesh = Mesh { corners, triangles: self.triangles, nodes: vec![], left_out: self.left_out, tangents };
        mesh.sort();
        Ok(mesh)
    }

    /// Corners with normals (area-weighted means of their triangles' normals where missing) and tangents (given, or
    /// along u).
    fn shaded(&self) -> Vec<Shaded> {
        let mut normals = vec![V3::zeros(); self.corners.len()];
        let mut tangents = normals.clone();
        for t in &self.triangles {
            let [a, b, c] = t.map(|k| self.corners[k as usize]);
            let (p, q) = (b.place - a.place, c.place - a.place);
            let normal = p.cross(&q);
            let along = match (a.uv, b.uv, c.uv) {
                (Some(a), Some(b), Some(c)) => {
                    let (du, dv) = ([b[0] - a[0], c[0] - a[0]], [b[1] - a[1], c[1] - a[1]]);
                    let det = du[0] * dv[1] - du[1] * dv[0];
                    let along = (p * dv[1] - q * dv[0]) * det.signum();
                    if det == 0.0 || along.norm() == 0.0 { V3::zeros() } else { along.normalize() * normal.norm() }
                }
                _ => V3::zeros(),
            };
            for k in t {
                normals[*k as usize] += normal;
                tangents[*k as usize] += along;
            }
        }
        let unit = |v: V3| (v.norm() > 1e-300 && v.norm().is_finite()).then(|| v.normalize());
        let each = self.corners.iter().zip(normals.into_iter().zip(tangents));
        each.map(|(corner, (normal, tangent))| {
            let normal = corner.normal.and_then(unit).or(unit(normal)).unwrap_or_else(V3::z);
            let tangent = corner.tangent.and_then(unit).or(unit(tangent)).unwrap_or_else(V3::zeros);
            Shaded { place: corner.place, normal, tangent, uv: corner.uv.unwrap_or([0.0; 2]) }
        })
        .collect()
    }
}

impl Mesh {
    /// Builds the hierarchy by halving the triangles along the longest side of the box of their centroids.
    fn sort(&mut self) {
        let middle = |m: &Self, t: &[u32; 3]| t.iter().map(|k| m.corners[*k as usize].place).sum::<V3>() / 3.0;
        let middles: Vec<V3> = self.triangles.iter().map(|t| middle(self, t)).collect();
        let mut order: Vec<u32> = (0..self.triangles.len() as u32).collect();
        let mut nodes = vec![];
        // Ranges to process, with the node whose second child they are.
        let mut todo = vec![(0, order.len(), None)];
        while let Some((from, to, parent)) = todo.pop() {
            let index = nodes.len();
            if let Some(parent) = parent {
                let parent: &mut Node = &mut nodes[parent];
                parent.first = index;
            }
            let part = &mut order[from..to];
            let (mut low, mut high) = (V3::repeat(f64::INFINITY), V3::repeat(f64::NEG_INFINITY));
            let [mut least, mut most] = [low, high];
            for t in part.iter() {
                for k in self.triangles[*t as usize] {
                    let p = self.corners[k as usize].place;
                    (low, high) = (low.inf(&p), high.sup(&p));
                }
                let m = middles[*t as usize];
                (least, most) = (least.inf(&m), most.sup(&m));
            }
            if part.len() <= LEAF {
                nodes.push(Node { low, high, first: from, count: to - from });
                continue;
            }
            let axis = (most - least).imax();
            let half = part.len() / 2;
            part.select_nth_unstable_by(half, |a, b| middles[*a as usize][axis].total_cmp(&middles[*b as usize][axis]));
            nodes.push(Node { low, high, first: 0, count: 0 });
            todo.push((from + half, to, Some(index)));
            todo.push((from, from + half, None));
        }
        self.triangles = order.iter().map(|t| self.triangles[*t as usize]).collect();
        self.nodes = nodes;
    }

    /// Number of nodes, and nodes and triangles in the layout for graphics cards, four numbers each. A node has its low
    /// corner with the second child or first triangle, and its high corner with the number of triangles. A triangle
    /// corner has its position and u, its normal and v, and its tangent.
    pub(crate) fn packed(&self) -> (usize, Vec<[f32; 4]>) {
        let four = |v: &V3, w: f64| [v.x as f32, v.y as f32, v.z as f32, w as f32];
        let node = |n: &Node| [four(&n.low, n.first as f64), four(&n.high, n.count as f64)];
        let corner = |k: &u32| {
            let c = &self.corners[*k as usize];
            [four(&c.place, c.uv[0]), four(&c.normal, c.uv[1]), four(&c.tangent, 0.0)]
        };
        let triangles = self.triangles.iter().flatten().flat_map(corner);
        (self.nodes.len(), self.nodes.iter().flat_map(node).chain(triangles).collect())
    }

    /// The nearest intersection of a ray with a triangle.
    pub(crate) fn meet(&self, ray: &Ray, [near, mut far]: [f64; 2]) -> Option<Hit> {
        let inverse = ray.along.map(|c| 1.0 / c);
        let mut best = None;
        let mut stack = [0_usize; 64];
        let mut depth = 1;
        while depth > 0 {
            depth -= 1;
            let index = stack[depth];
            let node = &self.nodes[index];
            if !node.meets(ray, inverse, [near, far]) {
                continue;
            }
            if node.count == 0 {
                // The tree is balanced, so 64 levels hold more triangles than fit into memory.
                stack[depth] = node.first;
                stack[depth + 1] = index + 1;
                depth += 2;
                continue;
            }
            for k in node.first..node.first + node.count {
                if let Some((t, weights)) = self.triangle(k, ray, [near, far]) {
                    far = t;
                    best = Some((k, t, weights));
                }
            }
        }
        best.map(|(k, t, weights)| self.shade(k, ray, t, weights))
    }

    /// Möller and Trumbore (1997): distance and barycentric weights.
    fn triangle(&self, k: usize, ray: &Ray, [near, far]: [f64; 2]) -> Option<(f64, [f64; 3])> {
        let [a, b, c] = self.triangles[k].map(|k| self.corners[k as usize].place);
        let (p, q) = (b - a, c - a);
        let h = ray.along.cross(&q);
        let det = p.dot(&h);
        if det == 0.0 {
            return None;
        }
        let s = (ray.from - a) / det;
        let u = s.dot(&h);
        let w = s.cross(&p);
        let v = ray.along.dot(&w);
        let t = q.dot(&w);
        let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > near && t < far;
        inside.then_some((t, [1.0 - u - v, u, v]))
    }

    fn shade(&self, k: usize, ray: &Ray, t: f64, weights: [f64; 3]) -> Hit {
        let corners = self.triangles[k].map(|k| self.corners[k as usize]);
        let mix = |of: &dyn Fn(&Shaded) -> V3| corners.iter().zip(weights).map(|(c, w)| of(c) * w).sum::<V3>();
        let [a, b, c] = corners.map(|c| c.place);
        let flat = (b - a).cross(&(c - a)).normalize();
        let smooth = mix(&|c| c.normal);
        let normal = if smooth.norm() > 1e-9 { smooth.normalize() } else { flat };
        // Mirrored (u, v) mirror the frame.
        let [p, q] = [1, 2].map(|i| [0, 1].map(|k| corners[i].uv[k] - corners[0].uv[k]));
        let handed = if (p[0] * q[1] - p[1] * q[0]) * flat.dot(&normal) < 0.0 { -1.0 } else { 1.0 };
        // Both normals are oriented alike, towards the ray.
        let flat = if flat.dot(&normal) < 0.0 { -flat } else { flat };
        let along = mix(&|c| c.tangent);
        let across = along - normal * along.dot(&normal);
        let tangent = if across.norm() > 1e-9 { across.normalize() } else { any_across(normal) };
        let uv = [0, 1].map(|i| corners.iter().zip(weights).map(|(c, w)| c.uv[i] * w).sum());
        let front = if flat.dot(&ray.along) > 0.0 { -1.0 } else { 1.0 };
        let mut n = normal * front;
        // A smoothed normal that faces away from the viewer is shaded as if seen edge-on.
        let away = n.dot(&ray.along);
        if away > -1e-3 {
            n = (n - ray.along * (away + 1e-3)).normalize();
        }
        Hit {
            t,
            point: ray.from + ray.along * t,
            flat: flat * front,
            frame: [tangent, normal.cross(&tangent) * handed, n],
            uv,
        }
    }
}

impl Node {
    fn meets(&self, ray: &Ray, inverse: V3, [near, far]: [f64; 2]) -> bool {
        let (mut from, mut to) = (near, far);
        for axis in 0..3 {
            let a = (self.low[axis] - ray.from[axis]) * inverse[axis];
            let b = (self.high[axis] - ray.from[axis]) * inverse[axis];
            // A ray within a side gives NaN, which max and min ignore.
            from = from.max(a.min(b));
            to = to.min(a.max(b) * (1.0 + 1e-12));
        }
        from <= to
    }
}

/// Whether a triangle has an area, relative to its longest side.
pub(crate) fn has_area([p, q, r]: [V3; 3]) -> bool {
    let longest = (q - p).norm_squared().max((r - p).norm_squared()).max((r - q).norm_squared());
    longest > 0.0 && (q - p).cross(&(r - p)).norm() > 1e-12 * longest
}

/// An arbitrary direction perpendicular to a normal.
fn any_across(n: V3) -> V3 {
    let axis = if n.x.abs() < 0.9 { V3::x() } else { V3::y() };
    (axis - n * axis.dot(&n)).normalize()
}
