defmodule BB.Dsl.Joint do
  @moduledoc "The words inside a joint, beside those for sensors and its child link."

  use BB.Dsl.Vocabulary, fields: [:type]
  import BB.Dsl.Vocabulary, only: [entity: 5]

  @doc "The joint's place in its parent link: `x`, `y`, `z` (lengths), `roll`, `pitch`, `yaw` (angles)."
  defmacro origin(fields), do: entity(:origin, [fields], 0, [BB.Dsl.Origin], __CALLER__)

  @doc "The direction in which the joint turns or slides: `x`, `y`, `z` (numbers)."
  defmacro axis(fields), do: entity(:axis, [fields], 0, [BB.Dsl.Axis], __CALLER__)

  @doc """
  What the joint may do at most: `lower`, `upper` (angles, or lengths of a prismatic joint), `effort` (torque or force),
  `velocity`.
  """
  defmacro limit(fields), do: entity(:limit, [fields], 0, [BB.Dsl.Limit], __CALLER__)

  @doc "How the joint resists: `damping`, `friction` (numbers in SI units)."
  defmacro dynamics(fields), do: entity(:dynamics, [fields], 0, [BB.Dsl.Dynamics], __CALLER__)
end
