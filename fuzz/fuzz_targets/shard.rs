//! Shards: `K/N`, and Slurm's variables.
#![no_main]

use generator::runner::Shard;

libfuzzer_sys::fuzz_target!(|text: &str| {
    if let Ok(shard) = Shard::parse(text) {
        assert!(shard.k >= 1 && shard.k <= shard.n);
    }
    let values: Vec<&str> = text.split('\n').collect();
    let names = ["ID", "MIN", "COUNT", "STEP"];
    let variable = |name: &str| {
        let i = names.iter().position(|n| name.ends_with(n))?;
        values.get(i).filter(|v| !v.is_empty()).map(|v| (*v).to_owned())
    };
    if let Ok(shard) = Shard::of_slurm(variable) {
        assert!(shard.k >= 1 && shard.k <= shard.n);
    }
});
