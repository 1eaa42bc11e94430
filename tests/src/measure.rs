//! Measures of a particle image.

/// Total, centroid, central second moments and the radii that contain 50 and 90 % of the light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measures {
    /// Sum of all pixels, counts.
    pub total: f64,
    /// Centroid along x, px; first pixel center = 1.
    pub cx: f64,
    /// Centroid along y, px.
    pub cy: f64,
    /// Central second moment along x, px^2.
    pub mxx: f64,
    /// Central second moment along y, px^2.
    pub myy: f64,
    /// Mixed central second moment, px^2.
    pub mxy: f64,
    /// Radius about the centroid that contains 50 % of the light, px.
    pub r50: f64,
    /// Radius about the centroid that contains 90 % of the light, px.
    pub r90: f64,
}

impl Measures {
    /// Names of the measures in the order of [`Measures::values`].
    pub const NAMES: [&str; 8] = ["total", "cx", "cy", "mxx", "myy", "mxy", "r50", "r90"];

    /// The measures in the order of [`Measures::NAMES`].
    pub fn values(&self) -> [f64; 8] {
        [self.total, self.cx, self.cy, self.mxx, self.myy, self.mxy, self.r50, self.r90]
    }

    /// Measures from their values in the order of [`Measures::NAMES`].
    pub fn from_values([total, cx, cy, mxx, myy, mxy, r50, r90]: [f64; 8]) -> Self {
        Measures { total, cx, cy, mxx, myy, mxy, r50, r90 }
    }
}

/// The lit pixels of an image of the given width: column and row (from 1) and value.
pub fn lit_pixels(width: usize, values: &[f64]) -> Vec<(f64, f64, f64)> {
    values
        .iter()
        .enumerate()
        .filter(|(_, v)| **v != 0.0)
        .map(|(i, &v)| ((i % width + 1) as f64, (i / width + 1) as f64, v))
        .collect()
}

/// Measures an image of the given width.
pub fn measure(width: usize, values: &[f64]) -> Measures {
    let lit = lit_pixels(width, values);
    let pixels = || lit.iter().copied();
    let total: f64 = values.iter().sum();
    let mean = |f: &dyn Fn(f64, f64) -> f64| pixels().map(|(x, y, v)| v * f(x, y)).sum::<f64>() / total;
    let (cx, cy) = (mean(&|x, _| x), mean(&|_, y| y));
    let mut rings: Vec<(f64, f64)> = pixels().map(|(x, y, v)| ((x - cx).hypot(y - cy), v)).collect();
    rings.sort_by(|a, b| a.0.total_cmp(&b.0));
    Measures {
        total,
        cx,
        cy,
        mxx: mean(&|x, _| (x - cx) * (x - cx)),
        myy: mean(&|_, y| (y - cy) * (y - cy)),
        mxy: mean(&|x, y| (x - cx) * (y - cy)),
        r50: radius_with(&rings, total, 0.5),
        r90: radius_with(&rings, total, 0.9),
    }
}

/// The radius r with E(r) = sum I clip(r - r_i + 0.5, 0, 1) / sum I equal to `share`, by bisection.
fn radius_with(rings: &[(f64, f64)], total: f64, share: f64) -> f64 {
    let held = |r: f64| rings.iter().map(|&(ri, v)| v * (r - ri + 0.5).clamp(0.0, 1.0)).sum::<f64>() / total;
    let (mut low, mut high) = (0.0, rings.last().map_or(0.0, |r| r.0) + 1.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if held(middle) < share { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_of_light() {
        let mut values = vec![0.0; 25];
        for i in [6, 7, 11, 12] {
            values[i] = 2.0;
        }
        let m = measure(5, &values);
        assert_eq!((m.total, m.cx, m.cy, m.mxx, m.myy, m.mxy), (8.0, 2.5, 2.5, 0.25, 0.25, 0.0));
        // All four pixels have the distance sqrt(0.5), at which exactly half of the light is inside.
        assert!((m.r50 - 0.5f64.sqrt()).abs() < 1e-9);
    }
}
