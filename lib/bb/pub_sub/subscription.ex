defmodule BB.PubSub.Subscription do
  @moduledoc """
  A subscription: one call of `BB.PubSub.subscribe/3` as data.

  The subscriber creates it, `BB.PubSub.Registrar` stores it, and publishers read it:

      subscription = Subscription.new([:sensor], max_rate: 10)
      Subscription.reaches?(subscription, [:sensor, :base_link, :imu])
      #=> true

  A subscription is *conditional* when only publishing decides whether it gets a message, because
  of `max_rate`, `max_queue` or `replay` (`BB.PubSub.Admission`). Options that are not given cost
  a publisher nothing.
  """

  alias BB.{Options, Path}
  alias BB.PubSub.SubscriptionState

  @enforce_keys [:id, :pid, :path, :counters]
  defstruct [
    :id,
    :pid,
    :path,
    :period_ns,
    :max_queue,
    :counters,
    message_types: [],
    replay: false,
    exact: false,
    unique: false
  ]

  @type t :: %__MODULE__{
          id: reference(),
          pid: pid(),
          path: Path.t(),
          message_types: [module()],
          period_ns: pos_integer() | nil,
          max_queue: non_neg_integer() | nil,
          replay: boolean(),
          exact: boolean(),
          unique: boolean(),
          counters: SubscriptionState.counters()
        }

  @schema Options.new!(
            message_types: [
              type: {:list, :module},
              default: [],
              doc: "Payload modules. Delivers only messages with one of these; `[]` delivers all."
            ],
            max_rate: [
              type: {:or, [:pos_integer, {:custom, __MODULE__, :check_rate, []}]},
              doc: "The most messages per second (Hz) of each path; the others are dropped."
            ],
            replay: [
              type: :boolean,
              default: false,
              doc: "Delivers the last message of each retained path at once, before newer ones."
            ],
            exact: [
              type: :boolean,
              default: false,
              doc: "Delivers only messages published at exactly this path, none from below it."
            ],
            unique: [
              type: :boolean,
              default: false,
              doc:
                "Delivers one copy of a message, even if other subscriptions of the caller match."
            ],
            max_queue: [
              type: :non_neg_integer,
              doc: "Skips the caller while more messages than this are in its mailbox."
            ]
          )

  @doc "Returns the schema for the options of `BB.PubSub.subscribe/3`."
  @spec schema() :: Options.t()
  def schema, do: @schema

  @doc """
  Creates a subscription of the calling process.

  Raises `ArgumentError` for an invalid path or option.
  """
  @spec new(Path.t(), keyword()) :: t()
  def new(path, opts) do
    opts = check!(opts)

    %__MODULE__{
      id: make_ref(),
      pid: self(),
      path: Path.validate!(path),
      counters: SubscriptionState.new_counters(),
      period_ns: opts[:max_rate] && ceil(1_000_000_000 / opts[:max_rate]),
      message_types: opts[:message_types],
      replay: opts[:replay],
      exact: opts[:exact],
      unique: opts[:unique],
      max_queue: opts[:max_queue]
    }
  end

  defp check!(opts) do
    case Options.validate(opts, @schema) do
      {:ok, opts} -> opts
      {:error, error} -> raise ArgumentError, Exception.message(error)
    end
  end

  @doc false
  def check_rate(rate) when is_float(rate) and rate > 0, do: {:ok, rate}

  def check_rate(other),
    do: {:error, "expected a rate in Hz, a number above 0, got: #{inspect(other)}"}

  @doc "Returns whether messages published at `path` reach the subscription, whatever their type."
  @spec reaches?(t(), Path.t()) :: boolean()
  def reaches?(%{exact: true, path: subscribed}, path), do: path == subscribed
  def reaches?(%{path: subscribed}, path), do: Path.prefix?(subscribed, path)

  @doc "Returns whether the subscription takes payloads of this type."
  @spec wants?(t(), module()) :: boolean()
  def wants?(%{message_types: []}, _type), do: true
  def wants?(%{message_types: types}, type), do: type in types

  @doc "Returns whether only publishing decides if the subscription gets a message."
  @spec conditional?(t()) :: boolean()
  def conditional?(%{period_ns: nil, max_queue: nil, replay: false}), do: false
  def conditional?(_subscription), do: true
end
