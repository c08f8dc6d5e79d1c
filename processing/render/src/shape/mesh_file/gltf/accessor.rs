//! Accessors: numbers of any component type, strided, sparse or without data, as `f64`.

use super::File;
use super::document::Accessor;
use crate::shape::mesh::MAX_TRIANGLES;
use crate::shape::mesh_file::fault::{Decoded, Fault};

/// Type of the components of an accessor.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of(code: u32) -> Decoded<Self> {
        Ok(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return Err(Fault::damaged(format!("has an accessor with the component type {code}"))),
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// Divisor of normalised integers.
    fn full_scale(self) -> f64 {
        match self {
            Self::I8 => 127.0,
            Self::U8 => 255.0,
            Self::I16 => 32_767.0,
            Self::U16 => 65_535.0,
            Self::U32 => f64::from(u32::MAX),
            Self::F32 => 1.0,
        }
    }

    fn value(self, bytes: &[u8]) -> f64 {
        match (self, bytes) {
            (Self::I8, [a]) => f64::from(*a as i8),
            (Self::U8, [a]) => f64::from(*a),
            (Self::I16, [a, b]) => f64::from(i16::from_le_bytes([*a, *b])),
            (Self::U16, [a, b]) => f64::from(u16::from_le_bytes([*a, *b])),
            (Self::U32, [a, b, c, d]) => f64::from(u32::from_le_bytes([*a, *b, *c, *d])),
            (Self::F32, [a, b, c, d]) => f64::from(f32::from_le_bytes([*a, *b, *c, *d])),
            _ => f64::NAN,
        }
    }
}

/// Elements of a view: offset, stride and component type.
struct Layout {
    view: usize,
    offset: usize,
    stride: Option<usize>,
    component: Component,
    count: usize,
}

impl File {
    /// All elements of a vertex attribute, one per vertex.
    ///
    /// # Errors
    /// As [`Self::elements`], and for another count than that of the vertices.
    pub(super) fn attribute<const N: usize>(&self, index: usize, vertices: usize) -> Decoded<Vec<[f64; N]>> {
        match self.document.accessors.get(index) {
            Some(accessor) if accessor.count != vertices => {
                let problem = format!("has {} elements in accessor {index} for {vertices} vertices", accessor.count);
                Err(Fault::damaged(problem))
            }
            _ => self.elements(index),
        }
    }

    /// All elements of an accessor, `N` components each.
    ///
    /// # Errors
    /// If it is missing, has other elements, is too long or exceeds its buffer.
    pub(super) fn elements<const N: usize>(&self, index: usize) -> Decoded<Vec<[f64; N]>> {
        let accessor = self.document.accessors.get(index);
        let accessor = accessor.ok_or_else(|| Fault::damaged(format!("names accessor {index}, which is not there")))?;
        let shape = match N {
            1 => "SCALAR",
            2 => "VEC2",
            3 => "VEC3",
            4 => "VEC4",
            _ => "MAT4",
        };
        if accessor.shape != shape {
            return Err(Fault::damaged(format!("has {} in accessor {index} instead of {shape}", accessor.shape)));
        }
        if accessor.count > 3 * MAX_TRIANGLES || (N > 1 && accessor.count > MAX_TRIANGLES) {
            let problem = format!("has {} elements in accessor {index}", accessor.count);
            return Err(Fault::refused(problem, "give a mesh of at most 20 million triangles"));
        }
        let component = Component::of(accessor.component_type)?;
        let mut elements = match accessor.buffer_view {
            Some(view) => {
                let layout =
                    Layout { view, offset: accessor.byte_offset, stride: None, component, count: accessor.count };
                self.values(&layout, index)?
            }
            None => vec![[0.0; N]; accessor.count],
        };
        self.apply_sparse(accessor, component, index, &mut elements)?;
        if accessor.normalized {
            let scale = component.full_scale();
            // The smallest signed integer also maps to -1.
            elements.as_flattened_mut().iter_mut().for_each(|v| *v = (*v / scale).max(-1.0));
        }
        Ok(elements)
    }

    fn apply_sparse<const N: usize>(
        &self,
        accessor: &Accessor,
        component: Component,
        index: usize,
        elements: &mut [[f64; N]],
    ) -> Decoded<()> {
        let Some(sparse) = &accessor.sparse else { return Ok(()) };
        if sparse.count > accessor.count {
            let problem = format!("has {} sparse elements of {} in accessor {index}", sparse.count, accessor.count);
            return Err(Fault::damaged(problem));
        }
        let places = Layout {
            view: sparse.indices.buffer_view,
            offset: sparse.indices.byte_offset,
            stride: Some(0),
            component: Component::of(sparse.indices.component_type)?,
            count: sparse.count,
        };
        let values = Layout {
            view: sparse.values.buffer_view,
            offset: sparse.values.byte_offset,
            stride: Some(0),
            component,
            count: sparse.count,
        };
        let places: Vec<[f64; 1]> = self.values(&places, index)?;
        let values: Vec<[f64; N]> = self.values(&values, index)?;
        for ([place], value) in places.into_iter().zip(values) {
            let beyond =
                || Fault::damaged(format!("has sparse element {place} of {} in accessor {index}", accessor.count));
            let valid = place >= 0.0 && place.fract() == 0.0;
            *elements.get_mut(place as usize).filter(|_| valid).ok_or_else(beyond)? = value;
        }
        Ok(())
    }

    /// Elements of a view, with the view's stride, or none if it is `Some(0)`.
    fn values<const N: usize>(&self, layout: &Layout, accessor: usize) -> Decoded<Vec<[f64; N]>> {
        let Layout { view, offset, stride, component, count } = layout;
        let missing = || Fault::damaged(format!("names buffer view {view}, which is not there"));
        let view = self.document.buffer_views.get(*view).ok_or_else(missing)?;
        let data = self.buffers.get(view.buffer).ok_or_else(|| Fault::damaged("names a buffer that is not there"))?;
        if data.is_empty() && view.byte_length > 0 {
            return Err(Fault::refused(
                format!("has buffer {} without data (a compressed mesh, or a .gltf that was a .glb)", view.buffer),
                "export the mesh without compression",
            ));
        }
        let beyond = || Fault::damaged(format!("has accessor {accessor} reach beyond its buffer"));
        let end = view.byte_offset.checked_add(view.byte_length).ok_or_else(beyond)?;
        let data = data.get(view.byte_offset..end).ok_or_else(beyond)?;
        let size = N * component.bytes();
        let stride = stride.map_or(view.byte_stride, |_| None).unwrap_or(size);
        let read = |k: usize| -> Option<[f64; N]> {
            let at = k.checked_mul(stride)?.checked_add(*offset)?;
            let bytes = data.get(at..at.checked_add(size)?)?;
            Some(std::array::from_fn(|c| component.value(&bytes[c * component.bytes()..(c + 1) * component.bytes()])))
        };
        if *count > 0 && read(count - 1).is_none() {
            return Err(beyond());
        }
        (0..*count).map(|k| read(k).ok_or_else(beyond)).collect()
    }
}
