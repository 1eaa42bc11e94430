//! Instruction sets for which the kernel is compiled, one of which is chosen when the program runs.

use std::fmt;

/// An instruction set that this processor has; all give the same counts.
#[derive(Debug, Clone, Copy)]
pub struct InstructionSet(Kind);

#[derive(Debug, Clone, Copy)]
enum Kind {
    /// What every processor of the target has, in vectors of 128 bits.
    Baseline,
    Detected(pulp::Arch),
}

impl InstructionSet {
    /// The widest that this processor has.
    pub fn best() -> Self {
        match pulp::Arch::new() {
            pulp::Arch::Scalar => InstructionSet(Kind::Baseline),
            arch => InstructionSet(Kind::Detected(arch)),
        }
    }

    /// All that this processor has, the narrowest first.
    pub fn available() -> Vec<Self> {
        let mut sets = vec![InstructionSet(Kind::Baseline)];
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = pulp::x86::V3::try_new().map(pulp::Arch::V3);
            let avx512 = pulp::x86::V4::try_new().map(pulp::Arch::V4);
            sets.extend(
                [avx2, avx512].into_iter().flatten().map(|arch| InstructionSet(Kind::Detected(arch))),
            );
        }
        #[cfg(not(target_arch = "x86_64"))]
        if let best @ InstructionSet(Kind::Detected(_)) = Self::best() {
            sets.push(best);
        }
        sets
    }

    /// Runs an operation compiled for this instruction set.
    #[inline]
    pub(super) fn dispatch<Operation: pulp::WithSimd>(self, operation: Operation) -> Operation::Output {
        match self.0 {
            Kind::Baseline => pulp::Simd::vectorize(pulp::Scalar128b, operation),
            Kind::Detected(arch) => arch.dispatch(operation),
        }
    }
}

impl fmt::Display for InstructionSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Kind::Baseline => f.write_str("baseline"),
            #[cfg(target_arch = "x86_64")]
            Kind::Detected(pulp::Arch::V3(_)) => f.write_str("AVX2"),
            #[cfg(target_arch = "x86_64")]
            Kind::Detected(pulp::Arch::V4(_)) => f.write_str("AVX-512"),
            Kind::Detected(arch) => write!(f, "{arch:?}"),
        }
    }
}
