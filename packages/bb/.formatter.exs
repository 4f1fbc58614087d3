# The words of a robot's declaration, which Ganglion's own .formatter.exs has. A driver or robot
# that depends on `:bb` writes `import_deps: [:bb]`.
{ganglion, _binding} = Code.eval_file("../../.formatter.exs", __DIR__)

[
  inputs: ["{mix,.formatter}.exs", "lib/**/*.ex"],
  export: ganglion[:export]
]
