defmodule BB.Message do
  @moduledoc """
  A message on the pubsub: the envelope with times and frame, and a payload.

  Create messages with `new/4`, and publish them with `BB.PubSub.publish/4`. Every message that a
  subscriber receives is one of these structs:

      iex> fields = [voltage: 7.4, current: -0.2]
      iex> {:ok, message} = BB.Message.new(BB.Message.Sensor.PowerState, :battery, fields)
      iex> {message.frame_id, message.payload.voltage, message.robot}
      {:battery, 7.4, nil}

  The fields are:

    * `payload` - what was measured, a struct of a payload module
    * `frame_id` - the coordinate frame or the part in which it was measured
    * `monotonic_time`, `wall_time` - the Erlang monotonic time and the system time of the
      measurement, in nanoseconds. Compare and subtract monotonic times; show and store wall
      times.
    * `node` - the node that created the message
    * `robot` - the robot on whose pubsub it was published, `nil` until then
    * `arm_epoch` - of a command, the arming of the robot that allows it (`BB.Safety.epoch/1`);
      `nil` in other messages

  ## Payloads

  A payload is a struct with a schema in the format of `BB.Options`. `use BB.Message` comes after
  `defstruct`:

      defmodule MyRobot.Message.Rain do
        defstruct [:rate, wet: false]

        use BB.Message,
          schema: [
            rate: [type: :float, required: true, doc: "The amount of rain, in m/s."],
            wet: [type: :boolean, default: false]
          ]
      end

  It defines:

    * `schema/0` - returns the schema
    * `new(frame_id, attrs)` - returns `{:ok, message}` or
      `{:error, %BB.Options.ValidationError{}}`. Its code is generated for this schema when the
      module is compiled, so a message is checked without walking the schema. Attributes that it
      refuses go to `BB.Options.validate/2`, which returns the reason.

  The module has the behaviour `BB.Message`, so an option of the type `{:behaviour, BB.Message}`
  takes it. A module that defines a `new/2` of its own keeps it, and reaches the checks by
  `BB.Message.new/3`.

  A key of the schema that is not a field of the struct raises `CompileError`. A `:float` field
  refuses integers: a driver that publishes `1` instead of `1.0` has likely forgotten to scale.
  Attributes are a keyword list or a map.
  """

  alias BB.Message.Compiler
  alias BB.Options

  defstruct [:monotonic_time, :wall_time, :node, :frame_id, :payload, :robot, :arm_epoch]

  @type t :: t(struct())

  @typedoc "A message with a payload of the given type."
  @type t(payload) :: %__MODULE__{
          monotonic_time: integer(),
          wall_time: integer(),
          node: node(),
          frame_id: atom(),
          payload: payload,
          robot: module() | nil,
          arm_epoch: integer() | nil
        }

  @type attrs :: keyword() | map()

  @typedoc "The times in nanoseconds. If one time is given, the other is calculated from it."
  @type times :: [monotonic_time: integer(), wall_time: integer()]

  @doc "Returns the schema of the payload. `use BB.Message` defines it."
  @callback schema() :: Options.t()

  @doc false
  defmacro __using__(opts) do
    quote do
      @behaviour BB.Message
      @bb_message_schema BB.Message.Compiler.schema!(unquote(opts), __ENV__)
      @before_compile BB.Message.Compiler
    end
  end

  @doc """
  Creates a message.

  Returns `{:ok, message}` or `{:error, %BB.Options.ValidationError{}}`. Raises `ArgumentError`
  when `module` is not a payload module, and `FunctionClauseError` when `frame_id` is no atom or
  `attrs` no list and no map.

  Give `times` for a measurement that was made earlier, for example by the clock of a camera or a
  chip. One of the two times is enough:

      iex> attrs = [voltage: 7.4, current: -0.2]
      iex> times = [monotonic_time: 1_000]
      iex> {:ok, message} = BB.Message.new(BB.Message.Sensor.PowerState, :battery, attrs, times)
      iex> message.monotonic_time
      1000
  """
  @spec new(module(), atom(), attrs(), times()) ::
          {:ok, t()} | {:error, Options.ValidationError.t()}
  def new(module, frame_id, attrs, times \\ [])
      when is_atom(frame_id) and (is_list(attrs) or is_map(attrs)) do
    case payload(module, attrs) do
      {:ok, payload} -> {:ok, wrap(payload, frame_id, times)}
      error -> error
    end
  end

  @doc "Creates a message as `new/4` does. Returns the message or raises the error."
  @spec new!(module(), atom(), attrs(), times()) :: t()
  def new!(module, frame_id, attrs, times \\ []) do
    case new(module, frame_id, attrs, times) do
      {:ok, message} -> message
      {:error, error} -> raise error
    end
  end

  @doc """
  Returns the schema of a payload module, or of a message's payload.

      iex> schema = BB.Message.schema(BB.Message.Sensor.PowerState)
      iex> Keyword.keys(schema.schema)
      [:voltage, :current, :power, :shunt_voltage]
  """
  @spec schema(module() | t()) :: Options.t()
  def schema(%__MODULE__{payload: %module{}}), do: schema(module)
  def schema(module), do: payload_module!(module).schema()

  @doc false
  def wrap(payload, frame_id, times \\ [])

  def wrap(payload, frame_id, []) when is_atom(frame_id) do
    monotonic_time = :erlang.monotonic_time(:nanosecond)
    envelope(payload, frame_id, monotonic_time, monotonic_time + offset())
  end

  def wrap(payload, frame_id, times) when is_atom(frame_id) do
    case Enum.sort(times) do
      [monotonic_time: m] when is_integer(m) ->
        envelope(payload, frame_id, m, m + offset())

      [wall_time: w] when is_integer(w) ->
        envelope(payload, frame_id, w - offset(), w)

      [monotonic_time: m, wall_time: w] when is_integer(m) and is_integer(w) ->
        envelope(payload, frame_id, m, w)

      _ ->
        raise ArgumentError,
              "expected :monotonic_time and :wall_time, integers in nanoseconds, as the " <>
                "times of a message, got: #{inspect(times)}"
    end
  end

  def wrap(_payload, frame_id, _times),
    do: raise(ArgumentError, "expected an atom as frame_id, got: #{inspect(frame_id)}")

  defp envelope(payload, frame_id, monotonic_time, wall_time) do
    %__MODULE__{
      monotonic_time: monotonic_time,
      wall_time: wall_time,
      node: node(),
      frame_id: frame_id,
      payload: payload,
      robot: nil
    }
  end

  # Both times come from one reading of the clock, so they are the same moment.
  defp offset, do: :erlang.time_offset(:nanosecond)

  # A payload module without generated code has its schema walked.
  defp payload(module, attrs) do
    module = payload_module!(module)

    if Compiler.compiled?(module),
      do: module.__payload__(attrs),
      else: Compiler.validate(module, attrs)
  end

  defp payload_module!(module) do
    if is_atom(module) and (Compiler.payload?(module) or loadable_payload?(module)) do
      module
    else
      raise ArgumentError,
            "expected a payload module, got: #{inspect(module)}; a payload module defines a " <>
              "struct and calls `use BB.Message, schema: …`"
    end
  end

  defp loadable_payload?(module), do: Code.ensure_loaded?(module) and Compiler.payload?(module)
end
