defmodule BB.Message.Option do
  @moduledoc """
  The types of fields that are vectors, rotations and joint states, for the schemas of payloads.
  Use them in a payload of your own:

      defmodule MyRobot.Message.Gust do
        import BB.Message.Option

        defstruct [:velocity, strengths: []]

        use BB.Message,
          schema: [
            velocity: [type: vec3_type(), required: true],
            strengths: [type: efforts_type(), default: []]
          ]
      end

  The types of lists take what `BB.Message.Sensor.JointState` does: a float for a joint that turns
  or slides, a struct for a planar or floating one. Integers are refused.
  """

  alias BB.Math.{Covariance3, Covariance6, Quaternion, Transform, Transform2D, Vec3}
  alias BB.Message.Geometry.{Twist, Twist2D, Wrench, Wrench2D}

  @type type :: {:custom, module(), atom(), [term()]}

  @typedoc "The result of a check."
  @type result :: {:ok, term()} | {:error, String.t()}

  structs = [
    vec3: Vec3,
    quaternion: Quaternion,
    transform: Transform,
    covariance3: Covariance3,
    covariance6: Covariance6
  ]

  for {name, module} <- structs do
    type = :"#{name}_type"
    validate = :"validate_#{name}"

    @doc "Returns the type of a field that is a `#{inspect(module)}`."
    @spec unquote(type)() :: type()
    def unquote(type)(), do: {:custom, __MODULE__, unquote(validate), [[]]}

    @doc "Checks that a value is a `#{inspect(module)}`."
    @spec unquote(validate)(term(), keyword()) :: result()
    def unquote(validate)(value, opts)
    def unquote(validate)(%unquote(module){} = value, _opts), do: {:ok, value}

    def unquote(validate)(value, _opts),
      do: {:error, "expected a #{unquote(inspect(module))}, got: #{inspect(value)}"}
  end

  lists = [
    configurations: {"positions", [Transform2D, Transform]},
    velocities: {"velocities", [Twist2D, Twist]},
    efforts: {"efforts", [Wrench2D, Wrench]}
  ]

  for {name, {content, [planar, floating]}} <- lists do
    type = :"#{name}_type"
    validate = :"validate_#{name}"

    @doc "Returns the type of a field with the #{content} of joints, a list."
    @spec unquote(type)() :: type()
    def unquote(type)(), do: {:custom, __MODULE__, unquote(validate), [[]]}

    @doc """
    Checks that a value is a list of floats, `#{inspect(planar)}` and `#{inspect(floating)}`.

        iex> BB.Message.Option.#{validate}([0.5, 1.5], [])
        {:ok, [0.5, 1.5]}
        iex> {:error, message} = BB.Message.Option.#{validate}([:nope], [])
        iex> message
        "expected element 0 to be a float, #{inspect(planar)}.t() or " <>
          "#{inspect(floating)}.t(), got: :nope"
    """
    @spec unquote(validate)(term(), keyword()) :: result()
    def unquote(validate)(value, _opts) do
      check_elements(
        value,
        &(is_float(&1) or is_struct(&1, unquote(planar)) or is_struct(&1, unquote(floating))),
        unquote("a float, #{inspect(planar)}.t() or #{inspect(floating)}.t()")
      )
    end
  end

  @doc false
  @spec check_elements(term(), (term() -> boolean()), String.t()) :: result()
  def check_elements(list, valid?, expected) do
    case find_invalid(list, valid?, 0) do
      nil ->
        {:ok, list}

      :not_a_list ->
        {:error, "expected a list, each element #{expected}, got: #{inspect(list)}"}

      {n, element} ->
        {:error, "expected element #{n} to be #{expected}, got: #{inspect(element)}"}
    end
  end

  defp find_invalid([element | rest], valid?, n),
    do: if(valid?.(element), do: find_invalid(rest, valid?, n + 1), else: {n, element})

  defp find_invalid([], _valid?, _n), do: nil
  defp find_invalid(_other, _valid?, _n), do: :not_a_list
end
