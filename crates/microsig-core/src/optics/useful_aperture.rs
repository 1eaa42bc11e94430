//! The part of the aperture whose light can reach the sensor.

/// The radius in the lens plane beyond which `misses` is true, in the unit of `aperture`: up to `steps` radii
/// are tested from the rim inward until one does not miss. `margin` steps are added because only discrete
/// radii are tested; the result is at most `aperture`.
pub fn useful_radius(aperture: f64, steps: u32, margin: u32, misses: impl Fn(f64) -> bool) -> f64 {
    let step = aperture / f64::from(steps);
    let missing = (0..steps).take_while(|&i| misses(aperture - f64::from(i) * step)).count();
    (aperture - step * (missing as f64 - f64::from(margin))).min(aperture)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_margin_is_kept_and_the_aperture_not_exceeded() {
        assert_eq!(useful_radius(8.0, 8, 1, |q| q > 4.5), 5.0);
        assert_eq!(useful_radius(8.0, 8, 2, |_| false), 8.0);
        assert_eq!(useful_radius(8.0, 8, 2, |_| true), 2.0);
    }
}
