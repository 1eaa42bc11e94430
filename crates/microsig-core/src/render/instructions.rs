//! Instruction sets for which the kernels are compiled; one is selected at run time.

use std::fmt;

/// An instruction set supported by this processor; all give the same counts.
#[derive(Debug, Clone, Copy)]
pub struct InstructionSet(Dispatch);

#[derive(Debug, Clone, Copy)]
enum Dispatch {
    /// The baseline of the target, with 128-bit vectors.
    Baseline,
    Detected(pulp::Arch),
}

impl InstructionSet {
    /// The widest instruction set of this processor.
    pub fn best() -> Self {
        match pulp::Arch::new() {
            pulp::Arch::Scalar => InstructionSet(Dispatch::Baseline),
            arch => InstructionSet(Dispatch::Detected(arch)),
        }
    }

    /// All instruction sets of this processor, the narrowest first.
    pub fn available() -> Vec<Self> {
        let mut sets = vec![InstructionSet(Dispatch::Baseline)];
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = pulp::x86::V3::try_new().map(pulp::Arch::V3);
            let avx512 = pulp::x86::V4::try_new().map(pulp::Arch::V4);
            sets.extend(
                [avx2, avx512].into_iter().flatten().map(|arch| InstructionSet(Dispatch::Detected(arch))),
            );
        }
        #[cfg(not(target_arch = "x86_64"))]
        if let best @ InstructionSet(Dispatch::Detected(_)) = Self::best() {
            sets.push(best);
        }
        sets
    }

    /// Runs an operation compiled for this instruction set.
    #[inline]
    pub(super) fn dispatch<Operation: pulp::WithSimd>(self, operation: Operation) -> Operation::Output {
        match self.0 {
            Dispatch::Baseline => pulp::Simd::vectorize(pulp::Scalar128b, operation),
            Dispatch::Detected(arch) => arch.dispatch(operation),
        }
    }
}

impl fmt::Display for InstructionSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Dispatch::Baseline => f.write_str("baseline"),
            #[cfg(target_arch = "x86_64")]
            Dispatch::Detected(pulp::Arch::V3(_)) => f.write_str("AVX2"),
            #[cfg(target_arch = "x86_64")]
            Dispatch::Detected(pulp::Arch::V4(_)) => f.write_str("AVX-512"),
            Dispatch::Detected(arch) => write!(f, "{arch:?}"),
        }
    }
}
