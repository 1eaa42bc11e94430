use storage::advice::Advice;

scores! {
    /// A probable mistake of convention, and the score without it, if it is known. Corrections are never applied.
    pub struct Hint {
        /// What may be wrong; it ends with the option of the command that reads the result so, or with the change
        /// to the file.
        pub what: String,
        /// The option of the command that reads the result without the mistake; empty if none does.
        pub option: String,
        /// The same for Python.
        pub argument: String,
        /// The question that `what` begins with. The rest of `what` quotes scores, which participants do not see
        /// if the truth is withheld.
        pub question: String,
        /// detection.f1 without the mistake.
        fraction f1: Option<f64>,
        /// detection.f1 as scored.
        fraction f1_now: Option<f64>,
        /// Fields: RMS end-point error without the mistake. Particles: RMS distance in the image plane.
        not_negative rms_px: Option<f64>,
        /// The same as scored.
        not_negative rms_px_now: Option<f64>,
        /// Whether this was tried only on a sample (the first frames).
        pub sampled: bool,
    }
}

impl Hint {
    /// A hint with a question and what makes it plausible.
    pub fn new(question: impl Into<String>, detail: &str) -> Self {
        let question = question.into();
        let what = format!("{question} {detail}").trim_end().to_owned();
        Hint { what, question, ..Hint::default() }
    }

    /// The hint, ended by the options that read the result without the mistake.
    #[must_use]
    pub fn with_options(self, options: &[Advice]) -> Self {
        let option: Vec<String> = options.iter().map(Advice::to_string).collect();
        // Two numbers are a tuple in Python.
        let argument = |option: &Advice| match option.python.split_once(" = ") {
            Some((key, value)) if value.contains(' ') => format!("{key}=({})", value.replace(' ', ", ")),
            _ => option.python.clone(),
        };
        let argument: Vec<String> = options.iter().map(argument).collect();
        let (option, argument) = (option.join(" "), argument.join(", "));
        Hint { what: format!("{}; {option}", self.what), option, argument, ..self }
    }

    /// The hint with the argument of Python.
    #[must_use]
    pub fn in_python(self) -> Self {
        match self.what.strip_suffix(&self.option).filter(|_| !self.option.is_empty()) {
            Some(what) => Hint { what: format!("{what}{}", self.argument), ..self },
            None => self,
        }
    }
}
