//! Templates of reports: text files with placeholders `{name}`.

/// Fills a template; panics on a value without placeholder and on an unfilled placeholder.
pub fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let mut filled = String::with_capacity(template.len());
    let mut rest = template;
    let mut used = vec![false; values.len()];
    while let Some((before, behind)) = rest.split_once('{') {
        let (name, after) = behind.split_once('}').expect("a brace that closes");
        let place = values.iter().position(|(known, _)| *known == name);
        let place = place.unwrap_or_else(|| panic!("nothing is known of {{{name}}}"));
        filled += before;
        filled += values[place].1;
        used[place] = true;
        rest = after;
    }
    for (used, (name, _)) in used.into_iter().zip(values) {
        assert!(used, "no {{{name}}} in the text");
    }
    filled + rest
}

#[cfg(test)]
mod tests {
    use super::fill;

    #[test]
    fn every_name_is_replaced_wherever_it_stands() {
        assert_eq!(fill("{a} and {b} and {a}.", &[("a", "1"), ("b", "{2}")]), "1 and {2} and 1.");
    }

    #[test]
    #[should_panic(expected = "nothing is known of {b}")]
    fn an_unknown_name_is_refused() {
        fill("{a} {b}", &[("a", "1")]);
    }

    #[test]
    #[should_panic(expected = "no {b} in the text")]
    fn a_value_without_a_place_is_refused() {
        fill("{a}", &[("a", "1"), ("b", "2")]);
    }
}
