//! Bessel functions of the first kind, J_0 to J_m together: by upward recurrence where it is stable,
//! otherwise by Miller's downward recurrence.

/// Fills `values` with J_0(x), J_1(x), ...; x >= 0. Errors are about 1e-15.
pub(super) fn bessel(x: f64, values: &mut [f64]) {
    values.fill(0.0);
    let Some(last) = values.len().checked_sub(1) else { return };
    if x < 1e-6 {
        values[0] = 1.0 - 0.25 * x * x;
        if last > 0 {
            values[1] = 0.5 * x;
        }
        return;
    }
    if last >= 1 && x > last as f64 {
        (values[0], values[1]) = (libm::j0(x), libm::j1(x));
        for order in 1..last {
            values[order + 1] = 2.0 * order as f64 / x * values[order] - values[order - 1];
        }
        return;
    }
    // Beyond this order, functions are below 1e-17 of the largest one.
    let far = (x + 11.0 * libm::cbrt(x) + 12.0) as usize;
    let start = far.max(last + 12).next_multiple_of(2);
    let inverse = 2.0 / x;
    let (mut after, mut value, mut even) = (0.0, 1e-250, 0.0);
    for order in (1..=start).rev() {
        if order <= last {
            values[order] = value;
        }
        if order % 2 == 0 {
            even += value;
        }
        (after, value) = (value, order as f64 * inverse * value - after);
        if value.abs() > 1e200 {
            const DOWN: f64 = 1e-250;
            value *= DOWN;
            after *= DOWN;
            even *= DOWN;
            values.iter_mut().for_each(|v| *v *= DOWN);
        }
    }
    values[0] = value;
    // J_0 + 2 J_2 + 2 J_4 + ... = 1.
    let scale = 1.0 / (value + 2.0 * even);
    values.iter_mut().for_each(|v| *v *= scale);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_those_of_libm() {
        let mut values = [0.0; 30];
        for x in [0.0, 1e-9, 1e-5, 0.01, 0.7, 3.0, 12.5, 29.9, 31.0, 100.0, 432.1] {
            bessel(x, &mut values);
            for (order, value) in values.iter().enumerate() {
                let expected = libm::jn(order as i32, x);
                assert!((value - expected).abs() < 3e-14, "J_{order}({x}) = {value}, not {expected}");
            }
        }
    }
}
