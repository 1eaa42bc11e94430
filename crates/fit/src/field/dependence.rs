//! Field dependence of the optics: regression of the values of single particles on their places.
//!
//! Each particle gives values with a covariance; particles scatter more than that, since no model is exact.
//! The regression weighs them by the sum of both, gives less weight to those far off (Huber), and takes
//! standard deviations from the particles' own residuals (sandwich estimator).

use microsig_core::optics::{ChiefRay, FieldAstigmatism, FieldComa, FieldOptics, FocusSurface, Vignetting};
use serde::Serialize;

use super::local::{
    ASTIGMATISM, BLUR, COMA, COUNT, DIAMETER, FOCUS, Local, MERIDIONAL, NA, SLOPE, SPHERICAL, TRANSMISSION,
    X, Y,
};
use microsig_core::linear::Symmetric;

/// A term of the field dependence.
struct Term {
    key: &'static str,
    unit: &'static str,
    /// The quantities that it changes, and by how much, at a place (mm).
    effect: fn([f64; 2]) -> Vec<(usize, f64)>,
}

const TERMS: [Term; 20] = [
    Term { key: "focus_um", unit: "um", effect: |_| vec![(FOCUS, 1.0)] },
    Term { key: "focus.tilt_um_per_mm.0", unit: "um/mm", effect: |[x, _]| vec![(FOCUS, x)] },
    Term { key: "focus.tilt_um_per_mm.1", unit: "um/mm", effect: |[_, y]| vec![(FOCUS, y)] },
    Term {
        key: "focus.curvature_um_per_mm2",
        unit: "um/mm^2",
        effect: |[x, y]| vec![(FOCUS, x * x + y * y)],
    },
    Term { key: "chief_ray.slope.0", unit: "", effect: |_| vec![(SLOPE, 1.0)] },
    Term { key: "chief_ray.slope.1", unit: "", effect: |_| vec![(SLOPE + 1, 1.0)] },
    Term { key: "chief_ray.per_mm", unit: "1/mm", effect: |[x, y]| vec![(SLOPE, x), (SLOPE + 1, y)] },
    Term { key: "numerical_aperture", unit: "", effect: |_| vec![(NA, 1.0)] },
    Term {
        key: "vignetting.meridional_per_mm2",
        unit: "1/mm^2",
        effect: |[x, y]| vec![(MERIDIONAL, -x * x - y * y)],
    },
    Term { key: "coma.constant.0", unit: "waves", effect: |_| vec![(COMA, 1.0)] },
    Term { key: "coma.constant.1", unit: "waves", effect: |_| vec![(COMA + 1, 1.0)] },
    Term { key: "coma.per_mm", unit: "waves/mm", effect: |[x, y]| vec![(COMA, x), (COMA + 1, y)] },
    Term { key: "astigmatism.constant.0", unit: "waves", effect: |_| vec![(ASTIGMATISM, 1.0)] },
    Term { key: "astigmatism.constant.1", unit: "waves", effect: |_| vec![(ASTIGMATISM + 1, 1.0)] },
    Term {
        key: "astigmatism.per_mm",
        unit: "waves/mm",
        effect: |[x, y]| vec![(ASTIGMATISM, x), (ASTIGMATISM + 1, y)],
    },
    Term {
        key: "astigmatism.per_mm2",
        unit: "waves/mm^2",
        effect: |[x, y]| vec![(ASTIGMATISM, x * x - y * y), (ASTIGMATISM + 1, 2.0 * x * y)],
    },
    Term { key: "spherical", unit: "waves", effect: |_| vec![(SPHERICAL, 1.0)] },
    Term { key: "blur_um", unit: "um", effect: |_| vec![(BLUR, 1.0)] },
    Term { key: "transmission", unit: "", effect: |_| vec![(TRANSMISSION, 1.0)] },
    Term { key: "particle_diameter_um", unit: "um", effect: |_| vec![(DIAMETER, 1.0)] },
];

/// The coefficient of the light over the field.
pub(super) const LIGHT: &str = "light_per_mm2";

/// The scatter of the focus of particles about the surface in focus.
pub(super) const SCATTER: &str = "focus.scatter_um";

/// A coefficient with its standard deviation.
#[derive(Debug, Clone, Serialize)]
pub struct Coefficient {
    /// Its key in `optics.field`, or what else it is.
    pub key: &'static str,
    /// Its value.
    pub value: f64,
    /// Its standard deviation.
    pub sd: f64,
    /// Its unit; empty if dimensionless.
    pub unit: &'static str,
}

impl Coefficient {
    /// Whether the 95 % interval excludes 0.
    pub(super) fn is_resolved(&self) -> bool {
        self.value.abs() > 1.96 * self.sd
    }
}

/// What one particle says.
#[derive(Debug, Clone)]
pub(super) struct Evidence {
    /// Its place, mm.
    pub(super) place: [f64; 2],
    pub(super) local: Local,
    /// The quantities that were fitted, and their covariance.
    pub(super) free: Vec<usize>,
    pub(super) covariance: Symmetric,
}

/// How optics depend on the place in the field.
#[derive(Debug, Clone)]
pub(super) struct FieldDependence {
    pub(super) coefficients: Vec<Coefficient>,
}

/// Number of iterations of weights and scatter.
const ITERATIONS: usize = 8;

/// Distance, in standard deviations, beyond which the weight of a particle falls.
const FAR: f64 = 2.0;

/// Fewest particles that determine the field dependence; with fewer, only tilt and curvature of the focus are fitted.
pub(super) const FEWEST: usize = 8;

/// Fewest particles that determine tilt and curvature of the focus and leave some to tell the scatter about them.
pub(super) const FEWEST_OF_FOCUS: usize = 6;

impl FieldDependence {
    /// The optics that the particles show, with their field dependence or the same everywhere; `None` if they do not determine
    /// them.
    pub(super) fn of(evidence: &[Evidence], is_field: bool) -> Option<FieldDependence> {
        let free = &evidence.first()?.free;
        let quantities: Vec<usize> = free.iter().copied().filter(|q| *q != X && *q != Y).collect();
        let is_constant = |term: &Term| (term.effect)([0.0; 2]).iter().any(|(_, by)| *by != 0.0);
        let is_free = |term: &Term| (term.effect)([1.0; 2]).iter().all(|(q, _)| free.contains(q));
        let is_determined = |term: &&Term| match evidence.len() {
            _ if !is_free(term) => false,
            FEWEST.. if is_field => true,
            FEWEST_OF_FOCUS.. if is_field => is_constant(term) || term.key.starts_with("focus."),
            _ => is_constant(term),
        };
        let terms: Vec<&Term> = TERMS.iter().filter(is_determined).collect();
        let n = quantities.len();
        let place_of = |quantity: usize| quantities.iter().position(|q| *q == quantity);
        // By particle: the matrix [quantities x terms] and the values less those without any term.
        let designs: Vec<Vec<f64>> = evidence
            .iter()
            .map(|of| {
                let mut design = vec![0.0; n * terms.len()];
                for (j, term) in terms.iter().enumerate() {
                    for (quantity, by) in (term.effect)(of.place) {
                        if let Some(i) = place_of(quantity) {
                            design[i * terms.len() + j] = by;
                        }
                    }
                }
                design
            })
            .collect();
        let values: Vec<Vec<f64>> = evidence
            .iter()
            .map(|of| {
                let base = |q: usize| if q == MERIDIONAL { 1.0 } else { 0.0 };
                quantities.iter().map(|q| of.local[*q] - base(*q)).collect()
            })
            .collect();
        let covariances: Vec<Symmetric> = evidence
            .iter()
            .map(|of| {
                let mut covariance = Symmetric::zeros(n);
                for (i, a) in quantities.iter().enumerate() {
                    for (j, b) in quantities.iter().enumerate() {
                        let place = |q: usize| of.free.iter().position(|f| *f == q);
                        if let (Some(a), Some(b)) = (place(*a), place(*b)) {
                            covariance.add(i, j, of.covariance.at(a, b));
                        }
                    }
                }
                covariance
            })
            .collect();
        let mut scatter: Vec<f64> = (0..n).map(|i| spread(&values, i)).collect();
        let mut robust = vec![1.0; evidence.len()];
        let mut solution = Vec::new();
        let mut deviation = Vec::new();
        for _ in 0..ITERATIONS {
            let weights = covariances
                .iter()
                .map(|covariance| {
                    let mut all = covariance.clone();
                    (0..n).for_each(|i| all.add(i, i, scatter[i] * scatter[i] + 1e-14));
                    all.inverse()
                })
                .collect::<Option<Vec<Symmetric>>>()?;
            let (found, sds, residuals) = regress(terms.len(), &designs, &values, &weights, &robust)?;
            // Scatter beyond the covariances, from all but the particles far off.
            for i in 0..n {
                let mut squares: Vec<f64> = residuals
                    .iter()
                    .zip(&covariances)
                    .map(|(residual, covariance)| residual[i] * residual[i] - covariance.at(i, i))
                    .collect();
                squares.sort_by(f64::total_cmp);
                let kept = &squares[..(squares.len() * 9).div_ceil(10)];
                // Residuals of few particles are smaller than their scatter.
                let of_quantity = |design: &[f64]| {
                    design[i * terms.len()..(i + 1) * terms.len()].iter().filter(|by| **by != 0.0).count()
                };
                let fitted = designs.iter().map(|design| of_quantity(design)).max().unwrap_or(0);
                let left = evidence.len().saturating_sub(fitted).max(1);
                let factor = (evidence.len() as f64 / left as f64).max(1.2);
                let mean = factor * kept.iter().sum::<f64>() / kept.len() as f64;
                scatter[i] = libm::sqrt(mean.max(1e-4 * scatter[i] * scatter[i]));
            }
            for ((robust, residual), weight) in robust.iter_mut().zip(&residuals).zip(&weights) {
                let distance = libm::sqrt(dot(residual, &weight.times(residual)) / n as f64);
                *robust = (FAR / distance.max(1e-9)).min(1.0);
            }
            solution = found;
            deviation = sds;
        }
        // The scatter of few particles about the surface in focus is uncertain: Student's t with two and three degrees of
        // freedom.
        let student = match evidence.len() {
            FEWEST_OF_FOCUS => 4.303 / 1.96,
            7 => 3.182 / 1.96,
            _ => 1.0,
        };
        let coefficients = terms.iter().zip(solution.iter().zip(&deviation)).map(|(term, (value, sd))| {
            let sd = if term.key.starts_with("focus") { student * sd } else { *sd };
            Coefficient { key: term.key, value: *value, sd, unit: term.unit }
        });
        Some(FieldDependence { coefficients: coefficients.collect() })
    }

    pub(super) fn coefficient(&self, key: &str) -> Option<&Coefficient> {
        self.coefficients.iter().find(|c| c.key == key)
    }

    fn value(&self, key: &str) -> f64 {
        self.coefficient(key).map_or(0.0, |c| c.value)
    }

    /// The quantities at a place (mm); the position and what is given as in `like`.
    pub(super) fn at(&self, place: [f64; 2], like: &Local) -> Local {
        let mut local = [0.0; COUNT];
        for index in [X, Y] {
            local[index] = like[index];
        }
        local[MERIDIONAL] = 1.0;
        for (quantity, key) in [(BLUR, "blur_um"), (DIAMETER, "particle_diameter_um")] {
            if self.coefficient(key).is_none() {
                local[quantity] = like[quantity];
            }
        }
        for term in &TERMS {
            for (quantity, by) in (term.effect)(place) {
                local[quantity] += by * self.value(term.key);
            }
        }
        local
    }

    pub(super) fn numerical_aperture(&self) -> f64 {
        self.value("numerical_aperture")
    }

    pub(super) fn blur_um(&self) -> f64 {
        self.value("blur_um")
    }

    pub(super) fn transmission(&self) -> f64 {
        self.value("transmission")
    }

    pub(super) fn spherical(&self) -> f64 {
        self.value("spherical")
    }

    /// Stage position in focus at the center of the field, um.
    pub(super) fn focus_um(&self) -> f64 {
        self.value("focus_um")
    }

    /// The terms of a scenario, and the keys of those that are not resolved and therefore 0. Depth grows away from the
    /// lens: `direction` is +1 if stage positions do.
    pub(super) fn field(&self, direction: f64) -> (FieldOptics, Vec<&'static str>) {
        let mut unresolved = Vec::new();
        let mut of = |key: &str| match self.coefficient(key) {
            Some(c) if c.is_resolved() => c.value,
            Some(c) => {
                unresolved.push(c.key);
                0.0
            }
            None => 0.0,
        };
        let field = FieldOptics {
            focus: FocusSurface {
                curvature_um_per_mm2: direction * of("focus.curvature_um_per_mm2"),
                tilt_um_per_mm: (
                    direction * of("focus.tilt_um_per_mm.0"),
                    direction * of("focus.tilt_um_per_mm.1"),
                ),
                scatter_um: of(SCATTER),
            },
            chief_ray: ChiefRay {
                slope: (of("chief_ray.slope.0"), of("chief_ray.slope.1")),
                per_mm: of("chief_ray.per_mm"),
            },
            distortion_per_mm2: 0.0,
            light_per_mm2: of(LIGHT),
            coma: FieldComa {
                constant: (of("coma.constant.0"), of("coma.constant.1")),
                per_mm: of("coma.per_mm"),
            },
            astigmatism: FieldAstigmatism {
                constant: (of("astigmatism.constant.0"), of("astigmatism.constant.1")),
                per_mm: of("astigmatism.per_mm"),
                per_mm2: of("astigmatism.per_mm2"),
            },
            vignetting: Vignetting {
                // Narrowing only: noise of an unvignetted field is no widening.
                meridional_per_mm2: of("vignetting.meridional_per_mm2").max(0.0),
            },
        };
        (field, unresolved)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Robust standard deviation of a column.
fn spread(values: &[Vec<f64>], column: usize) -> f64 {
    let mut all: Vec<f64> = values.iter().map(|row| row[column]).collect();
    all.sort_by(f64::total_cmp);
    let median = all[all.len() / 2];
    let mut deviations: Vec<f64> = all.iter().map(|value| (value - median).abs()).collect();
    deviations.sort_by(f64::total_cmp);
    (1.4826 * deviations[deviations.len() / 2]).max(1e-6)
}

/// Coefficients, their standard deviations and the residuals of each particle.
type Regression = (Vec<f64>, Vec<f64>, Vec<Vec<f64>>);

fn regress(
    m: usize,
    designs: &[Vec<f64>],
    values: &[Vec<f64>],
    weights: &[Symmetric],
    robust: &[f64],
) -> Option<Regression> {
    let n = values.first()?.len();
    let column = |design: &[f64], j: usize| -> Vec<f64> { (0..n).map(|i| design[i * m + j]).collect() };
    let mut normal = Symmetric::zeros(m);
    let mut right = vec![0.0; m];
    for (((design, value), weight), robust) in designs.iter().zip(values).zip(weights).zip(robust) {
        let columns: Vec<Vec<f64>> = (0..m).map(|j| column(design, j)).collect();
        for j in 0..m {
            let weighed = weight.times(&columns[j]);
            right[j] += robust * dot(&weighed, value);
            (0..m).for_each(|k| normal.add(j, k, robust * dot(&weighed, &columns[k])));
        }
    }
    let inverse = normal.inverse()?;
    let solution = inverse.times(&right);
    let residuals: Vec<Vec<f64>> = designs
        .iter()
        .zip(values)
        .map(|(design, value)| {
            (0..n).map(|i| value[i] - dot(&design[i * m..(i + 1) * m], &solution)).collect()
        })
        .collect();
    if designs.len() < FEWEST {
        // Too few to tell their scatter: the fits state the standard deviations.
        let sds = (0..m).map(|j| libm::sqrt(inverse.at(j, j))).collect();
        return Some((solution, sds, residuals));
    }
    // The spread of the particles' scores. A residual is smaller than the error of its particle by the particle's leverage
    // on the solution, most at the corners (HC3, MacKinnon and White 1985).
    let mut meat = Symmetric::zeros(m);
    for (((design, residual), weight), robust) in designs.iter().zip(&residuals).zip(weights).zip(robust) {
        let errors: Vec<f64> = (0..n)
            .map(|i| {
                let row = &design[i * m..(i + 1) * m];
                let leverage = robust * weight.at(i, i) * dot(row, &inverse.times(row));
                residual[i] / (1.0 - leverage).max(0.1)
            })
            .collect();
        let weighed = weight.times(&errors);
        let score: Vec<f64> = (0..m).map(|j| robust * dot(&column(design, j), &weighed)).collect();
        for j in 0..m {
            (0..m).for_each(|k| meat.add(j, k, score[j] * score[k]));
        }
    }
    let sds = (0..m)
        .map(|j| {
            let row: Vec<f64> = (0..m).map(|k| inverse.at(j, k)).collect();
            libm::sqrt(dot(&row, &meat.times(&row)).max(0.0))
        })
        .collect();
    Some((solution, sds, residuals))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::rngs::Xoshiro256PlusPlus;
    use rand::{RngExt as _, SeedableRng as _};

    /// Of fields of 20 particles. Standard deviations from the residuals and the number of terms (HC1) cover 89 % of the curvatures.
    #[test]
    fn intervals_cover_the_terms_of_particles_that_scatter() {
        let covered = coverage(&(0..20).collect::<Vec<_>>());
        assert_eq!(covered.len(), TERMS.len());
        let missed = |share: &f64| !(0.91..=0.985).contains(share);
        assert!(!covered.values().any(missed), "{covered:?}");
    }

    #[test]
    fn seven_particles_tell_tilt_and_curvature_of_the_focus() {
        for places in [&[0, 2, 4, 10, 13, 15, 19][..], &[0, 4, 7, 10, 15, 19]] {
            let covered = coverage(places);
            let focus = covered.iter().filter(|(key, _)| key.starts_with("focus"));
            let shares: Vec<f64> = focus.map(|(_, share)| *share).collect();
            assert_eq!((shares.len(), covered.contains_key("coma.per_mm")), (4, false));
            assert!(shares.iter().all(|share| (0.91..=0.985).contains(share)), "{places:?}: {covered:?}");
        }
    }

    /// The shares of fields of particles at these places of a grid in which the intervals contain the terms, 0.
    fn coverage(places: &[i32]) -> std::collections::BTreeMap<&'static str, f64> {
        const FIELDS: u64 = 1000;
        let mut covered = std::collections::BTreeMap::<&str, u32>::new();
        for field in 0..FIELDS {
            let mut random = Xoshiro256PlusPlus::seed_from_u64(field);
            // Nearly normal: the sum of twelve uniform numbers has a variance of 1.
            let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            let evidence: Vec<Evidence> = places
                .iter()
                .map(|&i| {
                    let place = [f64::from(i % 5) * 0.14 - 0.28, f64::from(i / 5) * 0.17 - 0.26];
                    let mut local = [0.0; COUNT];
                    local.iter_mut().for_each(|value| *value = 0.01 * normal());
                    local[MERIDIONAL] += 1.0;
                    let mut covariance = Symmetric::zeros(COUNT);
                    (0..COUNT).for_each(|q| covariance.add(q, q, 1e-8));
                    Evidence { place, local, free: (0..COUNT).collect(), covariance }
                })
                .collect();
            for found in FieldDependence::of(&evidence, true).unwrap().coefficients {
                *covered.entry(found.key).or_default() += u32::from(found.value.abs() < 1.96 * found.sd);
            }
        }
        covered.into_iter().map(|(key, count)| (key, f64::from(count) / FIELDS as f64)).collect()
    }

    /// Places on a grid with a known field dependence, small errors and two particles far off.
    #[test]
    fn the_field_dependence_is_found_despite_outliers() {
        let mut evidence = Vec::new();
        let mut state = 7u64;
        let mut noise = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1u32 << 31) - 0.5
        };
        for i in 0..30 {
            let [x, y] = [f64::from(i % 6) * 0.14 - 0.35, f64::from(i / 6) * 0.17 - 0.34];
            let mut local = [0.0; COUNT];
            local[FOCUS] = -1.5 + 3.8 * y + 5.2 * (x * x + y * y) + 0.05 * noise();
            local[NA] = 0.44 + 0.001 * noise();
            local[MERIDIONAL] = 1.0 - 0.36 * (x * x + y * y) + 0.004 * noise();
            local[COMA] = 0.04 - 0.127 * x + 0.004 * noise();
            local[COMA + 1] = -0.127 * y + 0.004 * noise();
            local[BLUR] = 0.87 + 0.01 * noise();
            if i == 3 || i == 17 {
                local[FOCUS] += 2.0;
                local[COMA] += 0.2;
            }
            let mut covariance = Symmetric::zeros(COUNT);
            (0..COUNT).for_each(|q| covariance.add(q, q, 1e-8));
            evidence.push(Evidence { place: [x, y], local, free: (0..COUNT).collect(), covariance });
        }
        let dependence = FieldDependence::of(&evidence, true).unwrap();
        for (key, expected) in [
            ("focus_um", -1.5),
            ("focus.tilt_um_per_mm.1", 3.8),
            ("focus.curvature_um_per_mm2", 5.2),
            ("numerical_aperture", 0.44),
            ("vignetting.meridional_per_mm2", 0.36),
            ("coma.constant.0", 0.04),
            ("coma.per_mm", -0.127),
            ("blur_um", 0.87),
        ] {
            let found = dependence.coefficients.iter().find(|c| c.key == key).unwrap();
            assert!((found.value - expected).abs() < 4.0 * found.sd.max(1e-4), "{found:?}, not {expected}");
            assert!(found.sd < 0.03 * (1.0 + expected.abs()), "{found:?}");
        }
        let few = FieldDependence::of(&evidence[..2], true).unwrap();
        assert_eq!(
            (few.value("coma.per_mm"), few.coefficients.len()),
            (0.0, 12),
            "optics of few are constant"
        );
        assert!((few.value("numerical_aperture") - 0.44).abs() < 1e-3, "{few:?}");
        let (field, _) = dependence.field(-1.0);
        assert!((field.focus.curvature_um_per_mm2 + 5.2).abs() < 0.3, "{field:?}");
    }
}
