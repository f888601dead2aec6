//! Precomputed transfer: how each vertex of what never moves answers to soft light, its own and its neighbours' shadow
//! counted (Eq. 20 of [Now11]).

use half::f16;

/// Of one object: for each vertex order^2 coefficients t_i, world frame, so that under light L a white matt surface radiates
/// the sum of t_i L_i. Kept as 16-bit floats: each is off by at most 2^-11 of itself (2.4e-4 in the mean), at an eighth of
/// the memory of f64 and half of that of f32: 32 bytes a vertex at order 4, 72 at order 6.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjectTransfer {
    /// Vertex by vertex.
    pub rows: Vec<f16>,
    /// Of a glossy object, for each vertex the order^2 coefficients of 1 - V, V(w) being 1 where nothing blocks (below the
    /// vertex's horizon the mirror image of what is above); else empty.
    pub blocked: Vec<f16>,
}

/// Of all objects of a scene that never move.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneTransfer {
    /// Order n of the rows; light of a lower order uses the first of each.
    pub order: usize,
    /// One for each object; `None` for one that may move.
    pub objects: Vec<Option<ObjectTransfer>>,
}

impl SceneTransfer {
    /// The rows of one object, each of order^2 numbers.
    pub fn rows(&self, object: usize) -> Option<std::slice::ChunksExact<'_, f16>> {
        let rows = &self.objects.get(object)?.as_ref()?.rows;
        Some(rows.chunks_exact((self.order * self.order).max(1)))
    }
}
