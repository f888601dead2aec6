//! How much each cube counts. A thin limb has little volume but as long a shadow as a thick one: what a body blocks is
//! its outline, whose area is volume over thickness. So cubes count by the mean thickness over their own.

/// No cube counts less or more than this.
const WEIGHTS: [f32; 2] = [0.4, 6.0];
/// 1 is the rule above; a little more makes up for limbs being rounder than bodies, so that a ball covers less of them.
const EXPONENT: f32 = 1.5;
/// Steps to a neighbour along 1, 2 and 3 axes, in thirds of a cube.
const STEPS: [i32; 3] = [3, 4, 5];

/// A weight for every cube: for an inner one the mean radius of the body over its own radius there (that of the largest
/// ball of inner cubes that holds it), within 0.4 to 6; for an outer one that of the nearest inner ones.
pub fn weights(size: [i32; 3], inside: &[bool]) -> Vec<f32> {
    let depth = depths(size, inside);
    let mut thickness = vec![0.0f32; inside.len()];
    let mut order: Vec<usize> = (0..inside.len()).filter(|&i| inside[i]).collect();
    order.sort_by_key(|&i| (-depth[i], i));
    let [nx, ny, nz] = size;
    let place = |i: usize| [i as i32 % nx, i as i32 / nx % ny, i as i32 / nx / ny];
    let index = |[x, y, z]: [i32; 3]| (x + nx * (y + ny * z)) as usize;
    for &cube in &order {
        let radius = depth[cube] as f32 / 3.0;
        // A larger ball has been here.
        if thickness[cube] >= 1.1 * radius {
            continue;
        }
        let [x, y, z] = place(cube);
        let reach = radius as i32;
        for dz in -reach..=reach {
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    let at = [x + dx, y + dy, z + dz];
                    let within =
                        (0..nx).contains(&at[0]) && (0..ny).contains(&at[1]) && (0..nz).contains(&at[2]);
                    if within && ((dx * dx + dy * dy + dz * dz) as f32) < radius * radius {
                        let slot = &mut thickness[index(at)];
                        *slot = slot.max(radius);
                    }
                }
            }
        }
    }
    let mean = order.iter().map(|&i| f64::from(thickness[i])).sum::<f64>() / order.len().max(1) as f64;
    let mut weights = vec![0.0f32; inside.len()];
    for &cube in &order {
        weights[cube] =
            (mean as f32 / thickness[cube].max(1.0 / 3.0)).powf(EXPONENT).clamp(WEIGHTS[0], WEIGHTS[1]);
    }
    // Outwards, shell by shell: the mean of the neighbours that have one.
    let mut shell = order;
    while !shell.is_empty() {
        let mut next = Vec::new();
        for &cube in &shell {
            for at in neighbours(size, place(cube)) {
                let at = index(at);
                if weights[at] == 0.0 {
                    weights[at] = -1.0;
                    next.push(at);
                }
            }
        }
        let means: Vec<f32> = next
            .iter()
            .map(|&cube| {
                let around = neighbours(size, place(cube)).map(|at| weights[index(at)]).filter(|w| *w > 0.0);
                let (sum, count) = around.fold((0.0, 0.0f32), |(sum, count), w| (sum + w, count + 1.0));
                sum / count.max(1.0)
            })
            .collect();
        next.iter().zip(means).for_each(|(&cube, weight)| weights[cube] = weight);
        shell = next;
    }
    weights
}

/// The up to six cubes that share a face.
fn neighbours([nx, ny, nz]: [i32; 3], [x, y, z]: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]]
        .into_iter()
        .map(move |[a, b, c]| [x + a, y + b, z + c])
        .filter(move |[x, y, z]| (0..nx).contains(x) && (0..ny).contains(y) && (0..nz).contains(z))
}

/// How far each inner cube is from the nearest outer one, in thirds of a cube, by steps to neighbours (5 % off at most);
/// 0 for outer ones. The grid's rim is outside.
fn depths([nx, ny, nz]: [i32; 3], inside: &[bool]) -> Vec<i32> {
    let mut depth: Vec<i32> = inside.iter().map(|&inside| if inside { i32::MAX / 2 } else { 0 }).collect();
    let index = |x: i32, y: i32, z: i32| (x + nx * (y + ny * z)) as usize;
    // Once forwards with the neighbours before each cube, once backwards with those after it.
    for sign in [1, -1] {
        let along = |n: i32, k: i32| if sign > 0 { k } else { n - 1 - k };
        for z in (0..nz).map(|k| along(nz, k)) {
            for y in (0..ny).map(|k| along(ny, k)) {
                for x in (0..nx).map(|k| along(nx, k)) {
                    let mut best = depth[index(x, y, z)];
                    for (dx, dy, dz) in EARLIER {
                        let (a, b, c) = (x - sign * dx, y - sign * dy, z - sign * dz);
                        let step = STEPS[(dx.abs() + dy.abs() + dz.abs() - 1) as usize];
                        let within = (0..nx).contains(&a) && (0..ny).contains(&b) && (0..nz).contains(&c);
                        best = best.min(step + if within { depth[index(a, b, c)] } else { 0 });
                    }
                    if inside[index(x, y, z)] {
                        depth[index(x, y, z)] = best;
                    }
                }
            }
        }
    }
    depth
}

/// Neighbours that come before a cube, as offsets to be taken away.
const EARLIER: [(i32, i32, i32); 13] = [
    (1, 0, 0),
    (0, 1, 0),
    (1, 1, 0),
    (-1, 1, 0),
    (0, 0, 1),
    (1, 0, 1),
    (-1, 0, 1),
    (0, 1, 1),
    (0, -1, 1),
    (1, 1, 1),
    (-1, 1, 1),
    (1, -1, 1),
    (-1, -1, 1),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thin_parts_count_more() {
        // A block of 12 x 12 x 12 with a rod of 3 x 3 x 20 on it.
        let size = [16, 16, 40];
        let inside: Vec<bool> = (0..16 * 16 * 40)
            .map(|i| {
                let (x, y, z) = (i % 16, i / 16 % 16, i / 256);
                let block = (2..14).contains(&x) && (2..14).contains(&y) && (2..14).contains(&z);
                block || ((6..9).contains(&x) && (6..9).contains(&y) && (14..34).contains(&z))
            })
            .collect();
        let weights = weights(size, &inside);
        let at = |x: usize, y: usize, z: usize| weights[x + 16 * (y + 16 * z)];
        // Radii: 6 in the block, 2 in the rod: 3 to the power of 1.5.
        let ratio = at(7, 7, 28) / at(7, 7, 8);
        assert!((ratio - 5.196).abs() < 0.3, "{ratio}");
        assert!((at(12, 7, 28) / at(7, 7, 28) - 1.0).abs() < 0.2, "beside the rod");
        assert!(weights.iter().all(|w| (WEIGHTS[0]..=WEIGHTS[1]).contains(w)));
    }
}
