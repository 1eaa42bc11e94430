//! Recordings in which hardly any particle can be found, by numbers that are known before they are tracked.

/// N_S above which images overlap almost everywhere.
const CROWDED: f64 = 1.0;

/// N_S up to which most particles can be found.
pub const USUAL_N_S: f64 = 0.3;

/// Signal-to-noise ratio below which images vanish in the noise, and at which most can be found.
const LEAST_SNR: f64 = 1.0;
const USUAL_SNR: f64 = 5.0;

/// The number of particles per pixel with N_S = [`USUAL_N_S`]; `None` without particles.
pub fn usual_ppp(n_ppp: f64, n_s: f64) -> Option<f64> {
    Some(n_ppp * USUAL_N_S / n_s).filter(|ppp| ppp.is_finite() && *ppp > 0.0)
}

/// Warnings, with the numbers that would do: of particles per pixel, N_S, and the median over depth of the signal-to-noise
/// ratio.
pub fn hopeless(n_ppp: f64, n_s: f64, snr: Option<f64>) -> Vec<String> {
    let crowded = usual_ppp(n_ppp, n_s).filter(|_| n_s > CROWDED).map(|ppp| {
        format!(
            "N_S = {}: over this depth range an image covers {:.0} px on average, and at {} particles per pixel images overlap almost \
             everywhere, so that hardly any single particle can be found; {} particles per pixel give N_S = {USUAL_N_S}",
            digits(n_s),
            n_s / n_ppp,
            digits(n_ppp),
            digits(ppp)
        )
    });
    let faint = snr.filter(|snr| *snr < LEAST_SNR).map(|snr| {
        let light = match USUAL_SNR / snr {
            more if more.is_finite() => format!("; {} times the light gives {USUAL_SNR}", digits(more)),
            _ => String::new(),
        };
        format!(
            "the median over depth of the signal-to-noise ratio is {}: most images vanish in the noise{light}",
            digits(snr)
        )
    });
    crowded.into_iter().chain(faint).collect()
}

/// Two significant digits, without an exponent.
pub fn digits(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let places = (1.0 - value.abs().log10().floor()).max(0.0) as usize;
    let text = format!("{value:.places$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_would_do_are_named() {
        assert!(hopeless(0.02, 0.9, Some(1.1)).is_empty() && hopeless(0.02, 0.0, None).is_empty());
        let said = hopeless(0.02, 201.0, Some(0.25));
        assert!(said[0].starts_with("N_S = 201: ") && said[0].contains("covers 10050 px"), "{said:?}");
        assert!(said[0].ends_with("0.00003 particles per pixel give N_S = 0.3"), "{said:?}");
        assert!(said[1].ends_with("20 times the light gives 5"), "{said:?}");
    }

    #[test]
    fn two_digits() {
        for (value, text) in [
            (0.000_030, "0.00003"),
            (0.0123, "0.012"),
            (1.25, "1.2"),
            (10.0, "10"),
            (201.4, "201"),
            (0.0, "0"),
        ] {
            assert_eq!(digits(value), text);
        }
    }
}
