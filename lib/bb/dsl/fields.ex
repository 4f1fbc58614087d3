defmodule BB.Dsl.Fields do
  @moduledoc """
  The fields of each entity of a robot's declaration, as a schema of `BB.Options`. Pure.
  `BB.Dsl.Grammar` and `BB.Dsl.Rules` read it; `BB.Dsl.Quantities` has the units that depend on
  the type of a joint.

      iex> Keyword.keys(BB.Dsl.Fields.of(:cylinder))
      [:radius, :height]
      iex> BB.Dsl.Fields.required(:mesh)
      [:filename]
  """

  alias BB.Dsl.Quantities

  @child {:or, [:module, {:tuple, [:module, :keyword_list]}]}
  @simulation [type: {:in, [:omit, :mock, :start]}]
  @atoms {:custom, __MODULE__, :check_atoms, []}
  @path {:custom, __MODULE__, :check_path, []}
  @duration {:custom, Quantities, :check_duration, []}

  @doc "Returns the fields of an entity of `kind`."
  @spec of(atom()) :: BB.Options.schema()
  def of(:settings) do
    [
      name: [type: :atom],
      topic_prefix: [type: {:custom, BB.Topic, :check_prefix, []}],
      parameter_store: [type: {:or, [@child, nil]}],
      registry_module: [type: :module],
      registry_options: [type: :keyword_list],
      supervisor_module: [type: :module],
      topology_max_restarts: [type: :non_neg_integer],
      topology_max_seconds: [type: :pos_integer]
    ]
  end

  def of(:param) do
    [doc: [type: :string]] ++
      for field <- [:type, :default, :min, :max], do: {field, [type: :any]}
  end

  def of(kind) when kind in [:group, :state], do: [doc: [type: :string]]
  def of(:bridge), do: [simulation: @simulation]
  def of(:states), do: [initial_state: [type: :atom]]
  def of(:joint), do: [type: [type: {:in, BB.Dsl.Grammar.joint_types()}]]

  def of(:sensor) do
    [
      required: [type: :boolean],
      retain: [type: :boolean],
      max_silence: [type: @duration]
    ]
  end

  def of(:actuator), do: [required: [type: :boolean]]
  def of(:controller), do: [required: [type: :boolean], simulation: @simulation]

  def of(:transmission) do
    [
      reduction: [type: {:custom, Quantities, :check_reduction, []}],
      offset: [type: {:or, [quantity(), nil]}],
      reversed?: [type: :boolean]
    ]
  end

  def of(:origin) do
    for(field <- [:x, :y, :z], do: {field, [type: a_length()]}) ++
      for field <- [:roll, :pitch, :yaw], do: {field, [type: an_angle()]}
  end

  def of(:axis) do
    for(field <- [:roll, :pitch, :yaw], do: {field, [type: an_angle()]}) ++
      for field <- [:x, :y, :z], do: {field, [type: :number]}
  end

  def of(:limit) do
    [
      lower: [type: quantity()],
      upper: [type: quantity()],
      effort: [type: quantity(), required: true],
      velocity: [type: quantity(), required: true],
      acceleration: [type: quantity()]
    ]
  end

  def of(:dynamics) do
    for field <- [:damping, :friction],
        do: {field, [type: {:custom, Quantities, :check_resistance, []}]}
  end

  def of(:inertial), do: [mass: [type: unit(:kilogram, "~u(0.5 kilogram)"), required: true]]

  def of(:inertia) do
    for field <- [:ixx, :iyy, :izz, :ixy, :ixz, :iyz] do
      type = unit(:kilogram_square_meter, "~u(0.01 kilogram_square_meter)")
      {field, [type: type, required: true]}
    end
  end

  def of(:collision), do: []
  def of(:box), do: lengths([:x, :y, :z])
  def of(kind) when kind in [:cylinder, :capsule], do: lengths([:radius, :height])
  def of(:sphere), do: lengths([:radius])

  def of(:mesh) do
    [
      filename: [type: :string, required: true],
      scale: [type: :number]
    ]
  end

  def of(:color) do
    type = {:custom, __MODULE__, :check_color, []}

    for(field <- [:red, :green, :blue], do: {field, [type: type, required: true]}) ++
      [alpha: [type: type]]
  end

  def of(:texture), do: [filename: [type: :string, required: true]]

  def of(:command) do
    [
      handler: [type: @child, required: true],
      timeout: [type: {:or, [:pos_integer, {:in, [:infinity]}]}],
      allowed_states: [type: @atoms],
      category: [type: :atom],
      cancel: [type: @atoms],
      arm: [type: :boolean],
      disarm: [type: :boolean]
    ]
  end

  def of(:argument) do
    [
      type: [type: :any, required: true],
      required: [type: :boolean],
      default: [type: :any],
      doc: [type: :string]
    ]
  end

  def of(:category), do: [doc: [type: :string], concurrency_limit: [type: :pos_integer]]

  def of(:estimator) do
    [
      sync_tolerance: [type: @duration],
      latency_budget: [type: @duration],
      lost_after: [type: @duration],
      recover_after: [type: :pos_integer],
      on_degraded: [type: :atom],
      on_lost: [type: :atom],
      on_recovered: [type: :atom]
    ]
  end

  def of(:input), do: [path: [type: @path, required: true], driver?: [type: :boolean]]
  def of(:output), do: [path: [type: @path]]
  def of(:i2c), do: [clock_hz: [type: :pos_integer]]

  def of(:gpio) do
    [
      lines: [type: :pos_integer],
      label: [type: :string],
      labels: [type: {:map, :non_neg_integer, :string}],
      timestamp_offset_ns: [type: :integer]
    ]
  end

  def of(_kind), do: []

  @doc "Returns the fields that an entity of `kind` must have."
  @spec required(atom()) :: [atom()]
  def required(kind), do: for({field, spec} <- of(kind), spec[:required], do: field)

  @doc """
  Casts the value of one field: `{:ok, value}`, or `{:error, reason}`.

      iex> BB.Dsl.Fields.cast(BB.Dsl.Fields.of(:axis), :x, "1")
      {:error, ~s(invalid value for :x option: expected number, got: "1")}
  """
  @spec cast(BB.Options.schema(), atom(), term()) :: {:ok, term()} | {:error, String.t()}
  def cast(schema, field, value) do
    case BB.Options.validate([{field, value}], Keyword.take(schema, [field])) do
      {:ok, options} -> {:ok, options[field]}
      {:error, error} -> {:error, Exception.message(error)}
    end
  end

  @doc false
  def check_color(value) when is_number(value) and value >= 0 and value <= 1, do: {:ok, value}

  def check_color(value) when is_number(value),
    do: {:error, "Color value must be between 0 and 1, got: #{inspect(value)}"}

  def check_color(value),
    do: {:error, "Expected a number for color value, from 0 to 1, got: #{inspect(value)}"}

  @doc false
  def check_atoms(value) do
    values = List.wrap(value)

    if is_list(value) or (is_atom(value) and value != nil),
      do: check_each(values, "an atom or a list of atoms", value),
      else: {:error, "expected an atom or a list of atoms, got: #{inspect(value)}"}
  end

  @doc false
  def check_path([_ | _] = path), do: check_each(path, a_path(), path)
  def check_path(value), do: {:error, "expected #{a_path()}, got: #{inspect(value)}"}

  defp check_each(atoms, expected, value) do
    if Enum.all?(atoms, &is_atom/1),
      do: {:ok, atoms},
      else: {:error, "expected #{expected}, got: #{inspect(value)}"}
  end

  defp a_path, do: "a path such as [:sensor, :base_link, :imu]"
  defp lengths(fields), do: for(field <- fields, do: {field, [type: a_length(), required: true]})
  defp quantity, do: {:custom, Quantities, :check_quantity, []}
  defp unit(unit, example), do: {:custom, Quantities, :check_unit, [unit, example]}
  defp a_length, do: unit(:meter, "~u(0.1 meter)")
  defp an_angle, do: unit(:radian, "~u(90 degree)")
end
