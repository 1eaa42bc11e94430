//! Free memory of the computer, and sizes as text.

/// A number of bytes as text with a unit.
pub fn size_text(bytes: u64) -> String {
    let mb = bytes as f64 / 1e6;
    if mb < 1e3 { format!("{mb:.1} MB") } else { format!("{:.1} GB", mb / 1e3) }
}

/// Free memory, bytes: the minimum of what the system, the control group and the limit of the process leave.
pub fn free_memory() -> Option<u64> {
    let read = |path: &str| std::fs::read_to_string(path).ok();
    let kib = |text: &str, key: &str| -> Option<u64> {
        let line = text.lines().find_map(|line| line.strip_prefix(key))?;
        Some(line.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
    };
    let system = read("/proc/meminfo").and_then(|text| kib(&text, "MemAvailable:"));
    // Only anonymous memory counts: the page cache is also charged to the group, but can be reclaimed.
    let group = read("/sys/fs/cgroup/memory.max").and_then(|most| {
        let stat = read("/sys/fs/cgroup/memory.stat")?;
        let used = stat.lines().find_map(|line| line.strip_prefix("anon "))?.trim().parse::<u64>().ok()?;
        Some(most.trim().parse::<u64>().ok()?.saturating_sub(used))
    });
    let limit = read("/proc/self/limits").and_then(|text| {
        let line = text.lines().find_map(|line| line.strip_prefix("Max address space"))?;
        let most = line.split_whitespace().next()?.parse::<u64>().ok()?;
        let used = kib(&read("/proc/self/status")?, "VmSize:")?;
        Some(most.saturating_sub(used))
    });
    [system, group, limit].into_iter().flatten().min()
}
