defmodule BB.PubSub.Subscription do
  @moduledoc """
  Who wants what: one call of `BB.PubSub.subscribe/3` as data.

  Options that are not given cost a publisher nothing. A subscription is *gated* when whether it
  gets a message is known only while that is published: because of its rate, its mailbox, or what
  has been replayed to it (`BB.PubSub.Gate`).
  """

  alias BB.{Options, Path}
  alias BB.PubSub.Gate

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
          counters: Gate.counters()
        }

  @schema Options.new!(
            message_types: [
              type: {:list, :module},
              default: [],
              doc: "Payload modules: only messages with one of these payloads; `[]` is all."
            ],
            max_rate: [
              type: {:or, [:pos_integer, {:custom, __MODULE__, :check_rate, []}]},
              doc:
                "At most so many messages a second (Hz) of each source path; the others are dropped."
            ],
            replay: [
              type: :boolean,
              default: false,
              doc:
                "Delivers the last message of each retained path at once, before anything newer from it."
            ],
            exact: [
              type: :boolean,
              default: false,
              doc: "Only what is published at this very path, nothing from below."
            ],
            unique: [
              type: :boolean,
              default: false,
              doc:
                "One copy of a message, although others of the caller's subscriptions get it too."
            ],
            max_queue: [
              type: :non_neg_integer,
              doc:
                "While more messages than this wait in the caller's mailbox, the caller is skipped."
            ]
          )

  @doc "The options of `BB.PubSub.subscribe/3`."
  @spec schema() :: Options.t()
  def schema, do: @schema

  @doc "The calling process's subscription to a path. Raises `ArgumentError` for what is no path or no option."
  @spec new(Path.t(), keyword()) :: t()
  def new(path, opts) do
    opts = check!(opts)

    %__MODULE__{
      id: make_ref(),
      pid: self(),
      path: Path.validate!(path),
      counters: Gate.counters(),
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

  @doc "Whether the subscription hears of what is published at the path, of whatever type."
  @spec reaches?(t(), Path.t()) :: boolean()
  def reaches?(%{exact: true, path: path}, source), do: path == source
  def reaches?(%{path: path}, source), do: Path.prefix?(path, source)

  @doc "Whether the subscription takes payloads of the type."
  @spec wants?(t(), module()) :: boolean()
  def wants?(%{message_types: []}, _type), do: true
  def wants?(%{message_types: types}, type), do: type in types

  @doc "Whether it takes a look at publishing to know that a message goes to it."
  @spec gated?(t()) :: boolean()
  def gated?(%{period_ns: nil, max_queue: nil, replay: false}), do: false
  def gated?(_subscription), do: true
end
