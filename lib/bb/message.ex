defmodule BB.Message do
  @moduledoc """
  The envelope of everything that a robot's parts tell each other.

  A message says what was measured (`payload`, a struct of one of the payload modules), in which coordinate frame or by which
  part (`frame_id`), and when: `monotonic_time` is the Erlang monotonic time and `wall_time` the system time of the same
  moment, both in nanoseconds. Compare and subtract monotonic times; show and store wall times. `node` is the node that made
  the message, `robot` the robot on whose pubsub it was published, `nil` until then.

      iex> {:ok, message} = BB.Message.new(BB.Message.Sensor.Range, :front,
      ...>   radiation_type: :infrared, field_of_view: 0.1, min_range: 0.02, max_range: 1.5, range: 0.4)
      iex> {message.frame_id, message.payload.range, message.robot}
      {:front, 0.4, nil}

  ## Payloads

  A payload is a struct with a schema in the format of `BB.Options`. `use BB.Message` comes after `defstruct`:

      defmodule MyRobot.Message.Rain do
        defstruct [:rate, wet: false]

        use BB.Message,
          schema: [
            rate: [type: :float, required: true, doc: "Metres a second."],
            wet: [type: :boolean, default: false]
          ]
      end

  It defines

    * `schema/0` - the schema
    * `new(frame_id, attrs)` - `{:ok, message}` or `{:error, %BB.Options.ValidationError{}}`, with code that was made for this
      schema when the module was compiled: a message is checked without walking the schema, and what it refuses is given to
      `BB.Options.validate/2`, which says why

  A module that defines a `new/2` of its own keeps it, and reaches the checks by `BB.Message.new/3`.

  A key of the schema that is not a field of the struct is a `CompileError`. A `:float` field refuses integers: a driver that
  publishes `1` where it means `1.0` has likely forgotten to scale. Attributes are a keyword list or a map.
  """

  alias BB.Message.Compiler
  alias BB.Options

  @enforce_keys [:monotonic_time, :wall_time, :node, :frame_id, :payload]
  defstruct [:monotonic_time, :wall_time, :node, :frame_id, :payload, :robot]

  @type t :: t(struct())

  @typedoc "A message with a payload of that type."
  @type t(payload) :: %__MODULE__{
          monotonic_time: integer(),
          wall_time: integer(),
          node: node(),
          frame_id: atom(),
          payload: payload,
          robot: module() | nil
        }

  @type attrs :: keyword() | map()

  @typedoc "When it was measured, in nanoseconds; the time that is not given is taken at the same moment."
  @type times :: [monotonic_time: integer(), wall_time: integer()]

  @doc false
  defmacro __using__(opts) do
    quote do
      @bb_message_schema BB.Message.Compiler.schema!(unquote(opts), __ENV__)
      @before_compile BB.Message.Compiler
    end
  end

  @doc """
  Makes a message: `{:ok, message}` or `{:error, %BB.Options.ValidationError{}}`.

  `times` is for what was measured earlier than now, by a camera's or a chip's own clock for example. One of the two times is
  enough.

      iex> attrs = [voltage: 7.4, current: -0.2]
      iex> {:ok, message} = BB.Message.new(BB.Message.Sensor.PowerState, :battery, attrs, monotonic_time: 1_000)
      iex> message.monotonic_time
      1000

  Raises `ArgumentError` when `module` is not a payload module.
  """
  @spec new(module(), atom(), attrs(), times()) ::
          {:ok, t()} | {:error, Options.ValidationError.t()}
  def new(module, frame_id, attrs, times \\ []) do
    case payload(module, attrs) do
      {:ok, payload} -> {:ok, wrap(payload, frame_id, times)}
      error -> error
    end
  end

  @doc "Like `new/4`, but returns the message itself or raises the error."
  @spec new!(module(), atom(), attrs(), times()) :: t()
  def new!(module, frame_id, attrs, times \\ []) do
    case new(module, frame_id, attrs, times) do
      {:ok, message} -> message
      {:error, error} -> raise error
    end
  end

  @doc "The schema of a payload module, as `BB.Options.new!/1` made it."
  @spec schema(module()) :: Options.t()
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
              "the times of a message are :monotonic_time and :wall_time, integers in nanoseconds, got: #{inspect(times)}"
    end
  end

  def wrap(_payload, frame_id, _times),
    do: raise(ArgumentError, "the frame_id of a message is an atom, got: #{inspect(frame_id)}")

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

  # One reading of the clock gives both times: they are the same moment, whatever runs in between.
  defp offset, do: :erlang.time_offset(:nanosecond)

  defp payload(module, attrs) do
    payload_module!(module).__payload__(attrs)
  end

  defp payload_module!(module) do
    if is_atom(module) and (Compiler.payload?(module) or loads?(module)) do
      module
    else
      raise ArgumentError,
            "#{inspect(module)} is not a payload: a payload is a struct's module with `use BB.Message, schema: …`"
    end
  end

  defp loads?(module), do: Code.ensure_loaded?(module) and Compiler.payload?(module)
end
