// A sweep as a Nextflow workflow, one task per case:
//   nextflow run examples/cluster/main.nf --sweep my_sweep.ron --out datasets/mine
// A profile with `process.executor = 'slurm'` runs the tasks on a cluster. See docs/cluster.md.
params.sweep = null
params.out = 'datasets/sweep'
params.microsig = 'microsig'

process LIST {
    executor 'local'

    input:
    val sweep

    output:
    stdout

    script:
    "${params.microsig} sweep '${sweep}' --list --quiet | cut -d ' ' -f 1"
}

// What is in the folder of the sweep already is not made again.
process CASE {
    cpus 2
    storeDir params.out

    input:
    tuple val(sweep), val(name)

    output:
    path name

    script:
    "${params.microsig} sweep '${sweep}' --out . --case ${name} --threads ${task.cpus} --quiet"
}

// The table of all cases.
process TABLE {
    executor 'local'
    storeDir params.out

    input:
    val sweep
    path cases

    output:
    path 'cases.csv'

    script:
    "${params.microsig} sweep '${sweep}' --out . --collect --quiet"
}

workflow {
    // Not staged: the sweep refers to its base scenario by a path relative to its own.
    sweep = file(params.sweep, checkIfExists: true).toAbsolutePath().toString()
    names = LIST(sweep).splitText { line -> line.trim() }
    made = CASE(names.map { name -> [sweep, name] })
    TABLE(sweep, made.collect())
}
